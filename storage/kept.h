// Where each kind of row that retention tells apart is found. Files of this folder only.
#pragma once

#include "storage/store.h"

namespace lampglow::storage {

struct Place {
  const char* table;
  const char* time;
  const char* where;  // beside the camera and the time
};

Place place_of(Kept what);

}  // namespace lampglow::storage
