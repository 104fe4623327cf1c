# OpenCV's core, imgproc and photo alone, and imgcodecs, which tests compare with, where it is. Debian ships OpenCVConfig.cmake
# only in libopencv-dev, which pulls in all of OpenCV with VTK and Qt; the module packages have headers and libraries, so we
# look for those.
find_path(OPENCV_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
foreach(module core imgproc photo imgcodecs)
  if(NOT TARGET opencv_${module})
    find_library(OPENCV_${module}_LIBRARY opencv_${module})
    if(NOT OPENCV_${module}_LIBRARY)
      if(module STREQUAL imgcodecs)
        continue()
      endif()
      message(FATAL_ERROR "opencv_${module} was not found (apt-get install libopencv-${module}-dev)")
    endif()
    add_library(opencv_${module} UNKNOWN IMPORTED GLOBAL)
    set_target_properties(opencv_${module} PROPERTIES
      IMPORTED_LOCATION "${OPENCV_${module}_LIBRARY}"
      INTERFACE_INCLUDE_DIRECTORIES "${OPENCV_INCLUDE_DIR}")
  endif()
endforeach()
set(OpenCVModules_FOUND TRUE)
