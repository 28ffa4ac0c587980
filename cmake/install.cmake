# Installing: library, public headers, pkg-config file, CMake package.
include(CMakePackageConfigHelpers)
install(TARGETS hadalens EXPORT hadalensTargets
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY lib/include/hadalens DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h")
if(BUILD_SHARED_LIBS)
    install(EXPORT hadalensTargets NAMESPACE hadalens:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/hadalens)
    configure_package_config_file(cmake/hadalensConfig.cmake.in ${PROJECT_BINARY_DIR}/hadalensConfig.cmake
        INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/hadalens)
    write_basic_package_version_file(${PROJECT_BINARY_DIR}/hadalensConfigVersion.cmake COMPATIBILITY SameMajorVersion)
    install(FILES ${PROJECT_BINARY_DIR}/hadalensConfig.cmake ${PROJECT_BINARY_DIR}/hadalensConfigVersion.cmake
            DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/hadalens)
endif()
configure_file(cmake/hadalens.pc.in ${PROJECT_BINARY_DIR}/hadalens.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/hadalens.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
