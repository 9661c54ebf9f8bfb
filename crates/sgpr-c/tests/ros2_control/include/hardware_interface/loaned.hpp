// Not ROS 2: see README.md.
#pragma once

#include "hardware_interface/handle.hpp"

namespace hardware_interface {

class LoanedStateInterface {
public:
    explicit LoanedStateInterface(StateInterface::ConstSharedPtr state) : state_(*state) {}
    template <typename T = double>
    [[nodiscard]] std::optional<T> get_optional(unsigned int = 10) const
    {
        return state_.get_optional<T>();
    }

private:
    const StateInterface &state_;
};

class LoanedCommandInterface {
public:
    explicit LoanedCommandInterface(CommandInterface::SharedPtr command) : command_(*command) {}
    template <typename T>
    [[nodiscard]] bool set_value(const T &value, unsigned int = 10)
    {
        return command_.set_value(value);
    }

private:
    CommandInterface &command_;
};

}  // namespace hardware_interface
