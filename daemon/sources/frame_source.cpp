#include "daemon/sources/frame_source.h"
