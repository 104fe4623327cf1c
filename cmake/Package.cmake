# What `cmake --install` puts where, and the .deb (cpack -G DEB): program, unit, user, folders, example configuration.
include(GNUInstallDirs)
install(FILES systemd/lampglow.service DESTINATION lib/systemd/system)
install(FILES systemd/lampglow.sysusers RENAME lampglow.conf DESTINATION lib/sysusers.d)
install(FILES systemd/lampglow.tmpfiles RENAME lampglow.conf DESTINATION lib/tmpfiles.d)
install(FILES systemd/lampglow.toml DESTINATION /etc/lampglow)
install(FILES systemd/lampglow.toml DESTINATION share/doc/lampglow/examples)
install(DIRECTORY docs/ DESTINATION share/doc/lampglow FILES_MATCHING PATTERN "*.md" PATTERN images EXCLUDE)
install(FILES systemd/debian/copyright DESTINATION share/doc/lampglow)
execute_process(COMMAND gzip -9nc "${CMAKE_SOURCE_DIR}/systemd/debian/changelog"
  OUTPUT_FILE "${CMAKE_BINARY_DIR}/changelog.gz" COMMAND_ERROR_IS_FATAL ANY)
install(FILES "${CMAKE_BINARY_DIR}/changelog.gz" DESTINATION share/doc/lampglow)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_PACKAGE_NAME lampglow)
set(CPACK_PACKAGE_CONTACT "lampglow <lampglow@localhost>")
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# procps: the unit's ExecReload calls /bin/kill.
set(CPACK_DEBIAN_PACKAGE_DEPENDS "systemd, passwd, procps")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA
  "${CMAKE_SOURCE_DIR}/systemd/debian/postinst;${CMAKE_SOURCE_DIR}/systemd/debian/prerm;${CMAKE_SOURCE_DIR}/systemd/debian/postrm;${CMAKE_SOURCE_DIR}/systemd/debian/conffiles")
include(CPack)
