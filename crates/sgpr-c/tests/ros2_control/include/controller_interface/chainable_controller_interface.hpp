// Not ROS 2: see README.md.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "hardware_interface/loaned.hpp"
#include "rclcpp/duration.hpp"
#include "rclcpp/logging.hpp"
#include "rclcpp/time.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace rclcpp {

using Value = std::variant<std::int64_t, std::string, std::vector<double>, std::vector<std::string>>;

class Parameter {
public:
    explicit Parameter(const Value &value) : value_(value) {}
    template <typename T>
    T get_value() const
    {
        return std::get<T>(value_);
    }

private:
    Value value_;
};

}  // namespace rclcpp

namespace rclcpp_lifecycle {

class LifecycleNode {
public:
    const char *get_name() const { return "feed_forward"; }
    rclcpp::Logger &get_logger() { return logger_; }
    bool has_parameter(const std::string &name) const { return parameters.count(name) > 0; }
    rclcpp::Parameter get_parameter(const std::string &name) const { return rclcpp::Parameter(parameters.at(name)); }
    std::map<std::string, rclcpp::Value> parameters;

private:
    rclcpp::Logger logger_;
};

}  // namespace rclcpp_lifecycle

namespace controller_interface {

enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };

struct InterfaceConfiguration {
    interface_configuration_type type = interface_configuration_type::NONE;
    std::vector<std::string> names = {};
};

class ChainableControllerInterface {
public:
    virtual ~ChainableControllerInterface() = default;
    virtual CallbackReturn on_init() = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;

    return_type update(const rclcpp::Time &time, const rclcpp::Duration &period)
    {
        if (!chained_ && update_reference_from_subscribers(time, period) != return_type::OK) {
            return return_type::ERROR;
        }
        return update_and_write_commands(time, period);
    }

    void assign_interfaces(std::vector<hardware_interface::LoanedCommandInterface> &&commands,
                           std::vector<hardware_interface::LoanedStateInterface> &&states)
    {
        // As there: moved, for elements that hold references are not assigned.
        command_interfaces_.swap(commands);
        state_interfaces_.swap(states);
    }

    bool set_chained_mode(bool chained)
    {
        chained_ = chained;
        return on_set_chained_mode(chained);
    }

    const std::vector<hardware_interface::CommandInterface::SharedPtr> &export_reference_interfaces()
    {
        return ordered_exported_reference_interfaces_ = on_export_reference_interfaces_list();
    }

    const std::vector<hardware_interface::StateInterface::SharedPtr> &export_state_interfaces()
    {
        return ordered_exported_state_interfaces_ = on_export_state_interfaces_list();
    }

    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }
    std::shared_ptr<const rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
    unsigned int get_update_rate() const { return 250; }

protected:
    template <typename T>
    T auto_declare(const std::string &name, const T &value)
    {
        return std::get<T>(node_->parameters.emplace(name, value).first->second);
    }

    virtual std::vector<hardware_interface::StateInterface::SharedPtr> on_export_state_interfaces_list() { return {}; }
    virtual std::vector<hardware_interface::CommandInterface::SharedPtr> on_export_reference_interfaces_list()
    {
        return {};
    }
    virtual bool on_set_chained_mode(bool) { return true; }
    virtual return_type update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    virtual return_type update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration &) = 0;

    std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
    std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
    std::vector<hardware_interface::StateInterface::SharedPtr> ordered_exported_state_interfaces_;
    std::vector<hardware_interface::CommandInterface::SharedPtr> ordered_exported_reference_interfaces_;

private:
    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ = std::make_shared<rclcpp_lifecycle::LifecycleNode>();
    bool chained_ = false;
};

}  // namespace controller_interface
