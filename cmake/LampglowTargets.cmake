# How every target of lampglow is made: one static library per folder, warnings as errors, sanitizers by option.
include_guard()
find_package(Threads REQUIRED)
find_package(PkgConfig REQUIRED)

find_program(CCACHE ccache)
if(CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER "${CCACHE}")
  set(CMAKE_C_COMPILER_LAUNCHER "${CCACHE}")
endif()

set(LAMPGLOW_SANITIZE "" CACHE STRING "Sanitizers, as for -fsanitize=; empty for none")

# The same bytes on every run and machine of one kind: no contraction of a*b+c that depends on the target.
add_library(lampglow_options INTERFACE)
target_compile_options(lampglow_options INTERFACE
  $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wpedantic -Werror -Wshadow -Wnon-virtual-dtor -Wold-style-cast
    -Woverloaded-virtual -Wnull-dereference -Wimplicit-fallthrough -ffp-contract=off
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>>  # g++ 12 warns falsely of std::string's operator+ (its bug 105651)
)
if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")  # for the fuzzers alone: clang warns of other things
  target_compile_options(lampglow_options INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-Wno-error>)
endif()
target_include_directories(lampglow_options INTERFACE "${CMAKE_SOURCE_DIR}")
if(LAMPGLOW_SANITIZE)
  target_compile_options(lampglow_options INTERFACE
    -fsanitize=${LAMPGLOW_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(lampglow_options INTERFACE -fsanitize=${LAMPGLOW_SANITIZE})
  if(LAMPGLOW_SANITIZE STREQUAL "thread")
    # g++ warns that its thread sanitizer does not see the bare fences of Boost.Asio's handlers.
    target_compile_options(lampglow_options INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-Wno-tsan>)
  endif()
endif()

# lampglow_library(NAME [DEPENDS ours...] [THIRD_PARTY targets...]): a static library of all .cpp files of this folder
# (not of folders below it). What it links is PRIVATE: nobody sees a third-party header through it.
function(lampglow_library name)
  cmake_parse_arguments(ARG "" "" "DEPENDS;THIRD_PARTY" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/*.cpp")
  add_library(${name} STATIC ${sources})
  target_link_libraries(${name} PRIVATE lampglow_options Threads::Threads ${ARG_DEPENDS} ${ARG_THIRD_PARTY})
endfunction()

# The tests that scripts/test builds under the address sanitizer.
add_custom_target(lampglow_unit_tests)

# lampglow_test(NAME DEPENDS ours... [THIRD_PARTY targets...] [LABEL label] [TIMEOUT seconds] [PROGRAM]): one GoogleTest
# program of all *_test.cpp in this folder; every test case is a CTest test, labelled unit unless told otherwise.
# PROGRAM: the test runs the lampglow program itself (LAMPGLOW_BINARY), so that one is built first.
function(lampglow_test name)
  cmake_parse_arguments(ARG "PROGRAM" "LABEL;TIMEOUT" "DEPENDS;THIRD_PARTY" ${ARGN})
  if(NOT ARG_LABEL)
    set(ARG_LABEL unit)
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  file(GLOB sources CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/*_test.cpp")
  add_executable(${name} ${sources})
  target_link_libraries(${name} PRIVATE lampglow_options Threads::Threads ${ARG_DEPENDS} ${ARG_THIRD_PARTY}
    GTest::gmock GTest::gtest_main)
  target_compile_definitions(${name} PRIVATE LAMPGLOW_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
  if(ARG_PROGRAM)
    target_compile_definitions(${name} PRIVATE LAMPGLOW_BINARY="$<TARGET_FILE:lampglow>")
    add_dependencies(${name} lampglow)
  elseif(ARG_LABEL STREQUAL "unit")
    add_dependencies(lampglow_unit_tests ${name})
  endif()
  gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST
    PROPERTIES LABELS ${ARG_LABEL} TIMEOUT ${ARG_TIMEOUT})
endfunction()
