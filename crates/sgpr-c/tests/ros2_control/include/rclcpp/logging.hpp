// Not ROS 2: see README.md.
#pragma once

#include <cstdarg>
#include <cstdio>
#include <string>

namespace rclcpp {
struct Logger {
    std::string last;
};

[[gnu::format(printf, 2, 3)]] inline void log(Logger &logger, const char *format, ...)
{
    char words[512];
    std::va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(words, sizeof words, format, arguments);
    va_end(arguments);
    logger.last = words;
}
}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) rclcpp::log(logger, __VA_ARGS__)
#define RCLCPP_WARN(logger, ...) rclcpp::log(logger, __VA_ARGS__)
