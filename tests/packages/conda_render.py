"""Reads the conda recipe by rattler-build's own reader and renders it for each platform: conda_render.py RECIPE VERSION.

Without conda's channels nothing can be built; what is held is that the recipe is valid, that every platform gets the
three packages of this version, that the packages name what they need, and that nothing needed for building is forgotten
(the names are those of CMake's checks).
"""

import sys
from pathlib import Path

import rattler_build

PLATFORMS = ("linux-64", "linux-aarch64", "osx-64", "osx-arm64")
PACKAGES = {"libhadalens", "hadalens", "hadalens-python"}
# what CMake asks for, by conda-forge's names
NEEDED = {"libtiff", "jansson", "xxhash", "cairo", "clfft", "opencl-headers"}
VARIANTS = """
c_compiler: [gcc]
c_stdlib: [sysroot]
"""


def names(specs: object) -> set[str]:
    """The names of what is required."""
    return {str(spec).split()[0] for spec in specs}  # type: ignore[union-attr]


def main() -> None:
    """Render and check."""
    path, version = Path(sys.argv[1]), sys.argv[2]
    recipe = rattler_build.Stage0Recipe.from_file(path)
    for platform in PLATFORMS:
        config = rattler_build.RenderConfig(platform=rattler_build.PlatformConfig(target_platform=platform))
        rendered = recipe.render(rattler_build.VariantConfig.from_yaml(VARIANTS), config)
        found = {}
        for variant in rendered:
            one = variant.recipe
            found[one.package.name] = one
            assert str(one.package.version) == version, f"{one.package.name} is {one.package.version}, not {version}"
            assert one.about.license == "MIT", one.about.license
        assert set(found) == PACKAGES, f"{platform}: {sorted(found)}"
        for name, one in found.items():
            missing = NEEDED - names(one.requirements.host)
            assert not missing, f"{name} is built without {sorted(missing)}"
        print(platform, ", ".join(f"{name} {one.package.version}" for name, one in sorted(found.items())))


main()
