// What a camera looks like in clear air: the yardstick of every later frame.
#pragma once

#include <string>
#include <vector>

namespace lampglow {

struct ReferenceLamp {
  std::string id;
  double strength = 0;  // direct irradiance times distance squared, freed of the reference night's extinction
  double strength_rel_sigma = 0;  // its usual variation from night to night
};

struct ClearReference {
  std::vector<ReferenceLamp> lamps;
};

}  // namespace lampglow
