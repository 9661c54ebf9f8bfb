// Not ROS 2: see README.md.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>

namespace hardware_interface {

class Handle {
public:
    explicit Handle(const std::string &prefix, const std::string &interface, const std::string & = "double",
                    const std::string & = "")
        : name_(prefix + "/" + interface)
    {
    }
    const std::string &get_name() const { return name_; }
    /// None while somebody else holds the lock: here, while the test says so.
    template <typename T = double>
    [[nodiscard]] std::optional<T> get_optional() const
    {
        return locked ? std::nullopt : std::optional<T>(value_);
    }
    template <typename T>
    [[nodiscard]] bool set_value(const T &value)
    {
        if (locked) {
            return false;
        }
        value_ = value;
        return true;
    }
    bool locked = false;

private:
    std::string name_;
    double value_ = std::numeric_limits<double>::quiet_NaN();
};

class StateInterface : public Handle {
public:
    using Handle::Handle;
    using SharedPtr = std::shared_ptr<StateInterface>;
    using ConstSharedPtr = std::shared_ptr<const StateInterface>;
};

class CommandInterface : public Handle {
public:
    using Handle::Handle;
    using SharedPtr = std::shared_ptr<CommandInterface>;
};

}  // namespace hardware_interface
