// What an action complains about: the text and exit code of its CommandError.
#pragma once

#include <functional>
#include <string>

#include "daemon/errors.h"

namespace lampglow::test {

struct Complaint {
  int exit_code = 0;
  std::string text;
};

inline Complaint complaint_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const daemon::CommandError& error) {
    return {error.exit_code(), error.what()};
  }
  return {};
}

}  // namespace lampglow::test
