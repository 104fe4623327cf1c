#include "estimator/photometry/image.h"
