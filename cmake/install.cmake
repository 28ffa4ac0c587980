# Installing: library, public headers, pkg-config file, CMake package.
include(CMakePackageConfigHelpers)
install(TARGETS hadalens EXPORT hadalensTargets
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY lib/include/hadalens DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h")
install(EXPORT hadalensTargets NAMESPACE hadalens:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/hadalens)
configure_package_config_file(cmake/hadalensConfig.cmake.in ${PROJECT_BINARY_DIR}/hadalensConfig.cmake
    INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/hadalens)
# Below 1.0 a minor version may change what programs use.
if(PROJECT_VERSION VERSION_LESS 1.0)
    set(compatible SameMinorVersion)
else()
    set(compatible SameMajorVersion)
endif()
write_basic_package_version_file(${PROJECT_BINARY_DIR}/hadalensConfigVersion.cmake COMPATIBILITY ${compatible})
install(FILES ${PROJECT_BINARY_DIR}/hadalensConfig.cmake ${PROJECT_BINARY_DIR}/hadalensConfigVersion.cmake
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/hadalens)
# Only who links the static library has to have what it stands on; pkg-config asks everybody for what is named here.
if(NOT BUILD_SHARED_LIBS)
    set(HADALENS_PC_REQUIRES "OpenCL libtiff-4 jansson libxxhash")
    set(HADALENS_PC_LIBS "-lclFFT -lm -lpthread -ldl")
endif()
configure_file(cmake/hadalens.pc.in ${PROJECT_BINARY_DIR}/hadalens.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/hadalens.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)

# cmake --build build/release --target uninstall
if(PROJECT_IS_TOP_LEVEL)
    add_custom_target(uninstall COMMAND ${CMAKE_COMMAND} -DBUILD=${PROJECT_BINARY_DIR} -P ${PROJECT_SOURCE_DIR}/cmake/uninstall.cmake
        COMMENT "Uninstalling" VERBATIM)

    # The source archive of the commit at hand, in dist of the build
    add_custom_target(dist COMMAND ${PROJECT_SOURCE_DIR}/bindings/packaging/dist.sh ${PROJECT_BINARY_DIR}/dist
        COMMENT "Making the source archive" VERBATIM)
endif()
