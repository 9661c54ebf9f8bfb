// Not ROS 2: see README.md.
#pragma once

#include <type_traits>

#define PLUGINLIB_EXPORT_CLASS(derived, base) static_assert(std::is_base_of_v<base, derived>, "of its base");
