"""The benchmark of perf/benchopt: its files are what benchopt expects; with benchopt it runs."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "perf" / "benchopt"
KINDS = {"datasets": ("Dataset", {"get_data"}), "solvers": ("Solver", {"set_objective", "run", "get_result"})}
OBJECTIVE = "Objective", {"set_data", "get_objective", "evaluate_result", "get_one_result"}


@pytest.mark.parametrize("path", [FOLDER / "objective.py", *FOLDER.glob("*s/*.py")], ids=str)
def test_files_are_whole(path: Path) -> None:
    """Each compiles, has its class with its methods, and a literal list of requirements."""
    name, methods = KINDS.get(path.parent.name, OBJECTIVE)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kind = next(node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == name)
    assert methods <= {node.name for node in kind.body if isinstance(node, ast.FunctionDef)}
    values = {ast.unparse(node.targets[0]): node.value for node in kind.body if isinstance(node, ast.Assign)}
    assert isinstance(ast.literal_eval(values["name"]), str)
    assert all(each.startswith("pip::") for each in ast.literal_eval(values["requirements"]))


def test_it_runs(tmp_path: Path) -> None:
    """A small camera, from end to end."""
    pytest.importorskip("benchopt")
    copy = shutil.copytree(FOLDER, tmp_path / "lensless", ignore=shutil.ignore_patterns("outputs", "__*"))
    data = "simulated[size=[(48,64)],window=[(24,24)],frames=1]"
    words = ["-m", "benchopt", "run", str(copy), "-d", data, "-s", "hadalens", "-n", "2", "-r", "1", "--no-plot"]
    done = subprocess.run([sys.executable, *words, "--no-html"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "method=refine" in done.stdout
    assert list(copy.glob("outputs/*.parquet"))
