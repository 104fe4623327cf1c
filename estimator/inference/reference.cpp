#include "estimator/inference/reference.h"
