// Not ROS 2: see README.md.
#pragma once

namespace rclcpp {
class Time {};
}  // namespace rclcpp
