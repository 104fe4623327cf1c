# OpenCV's core, imgproc, imgcodecs and photo alone. Debian ships OpenCVConfig.cmake only in libopencv-dev, which pulls in all of
# OpenCV with VTK and Qt; the module packages have headers and libraries, so we look for those.
find_path(OPENCV_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
foreach(module core imgproc imgcodecs photo)
  if(NOT TARGET opencv_${module})
    find_library(OPENCV_${module}_LIBRARY opencv_${module} REQUIRED)
    add_library(opencv_${module} UNKNOWN IMPORTED GLOBAL)
    set_target_properties(opencv_${module} PROPERTIES
      IMPORTED_LOCATION "${OPENCV_${module}_LIBRARY}"
      INTERFACE_INCLUDE_DIRECTORIES "${OPENCV_INCLUDE_DIR}")
  endif()
endforeach()
set(OpenCVModules_FOUND TRUE)
