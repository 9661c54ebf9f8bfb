#include "sgpr_feed_forward_controller/feed_forward_controller.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "hardware_interface/types/hardware_interface_type_values.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/logging.hpp"

namespace sgpr_feed_forward_controller {

using controller_interface::CallbackReturn;
using controller_interface::return_type;
using hardware_interface::HW_IF_ACCELERATION;
using hardware_interface::HW_IF_EFFORT;
using hardware_interface::HW_IF_POSITION;
using hardware_interface::HW_IF_VELOCITY;

namespace {

/// Replaces a value by the one that an interface has; false, and the last good value stays, if that is none.
template <typename Interface>
bool read(const Interface &interface, double &value)
{
    const std::optional<double> found = interface.template get_optional<double>();
    if (!found.has_value() || !std::isfinite(*found)) {
        return false;
    }
    value = *found;
    return true;
}

std::int32_t fallback(const std::string &name)
{
    if (name != "last" && name != "zero") {
        throw std::invalid_argument("fallback: got \"" + name + "\", expected \"last\" or \"zero\"");
    }
    return name == "last" ? SGPR_LAST_TORQUE : SGPR_ZERO_TORQUE;
}

}  // namespace

CallbackReturn FeedForwardController::on_init()
{
    try {
        auto_declare<std::string>("model", "");
        auto_declare<std::string>("joint_prefix", "");
        for (const char *name : {"position_gains", "velocity_gains", "effort_limits"}) {
            auto_declare<std::vector<double>>(name, {});
        }
        auto_declare<std::vector<std::string>>("keep", {});
        auto_declare<std::string>("fallback", "last");
        auto_declare<std::int64_t>("most_errors", 10);
    } catch (const std::exception &error) {
        RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
        return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
}

std::vector<double> FeedForwardController::per_joint(const std::string &parameter) const
{
    std::vector<double> values = get_node()->get_parameter(parameter).get_value<std::vector<double>>();
    if (values.size() == 1) {
        values.resize(joints_.size(), values.front());
    }
    const auto bad = [](double value) { return !(std::isfinite(value) && value >= 0.0); };
    if (values.size() != joints_.size() || std::any_of(values.begin(), values.end(), bad)) {
        throw std::invalid_argument(parameter + ": expected " + std::to_string(joints_.size()) +
                                    " finite numbers from zero on, one per joint of the model, or one for all");
    }
    return values;
}

CallbackReturn FeedForwardController::on_configure(const rclcpp_lifecycle::State &)
{
    try {
        const auto text = [this](const char *name) { return get_node()->get_parameter(name).get_value<std::string>(); };
        const sgpr::Model model(text("model"));
        joints_ = model.joint_names();
        for (std::string &joint : joints_) {
            joint = text("joint_prefix") + joint;
        }
        sgpr::Options options;
        options.rate_hz = get_update_rate();
        options.keep = get_node()->get_parameter("keep").get_value<std::vector<std::string>>();
        options.keep.erase(std::remove(options.keep.begin(), options.keep.end(), ""), options.keep.end());
        predictor_.emplace(model, options);
        predictor_->set_fallback(fallback(text("fallback")));
        position_gains_ = per_joint("position_gains");
        velocity_gains_ = per_joint("velocity_gains");
        limits_ = per_joint("effort_limits");
        most_errors_ = get_node()->get_parameter("most_errors").get_value<std::int64_t>();
    } catch (const std::exception &error) {
        RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
        return CallbackReturn::ERROR;
    }
    const std::vector<double> zeros(joints_.size(), 0.0);
    measured_ = wanted_ = {zeros, zeros, zeros};
    effort_ = zeros;
    return CallbackReturn::SUCCESS;
}

std::vector<std::string> FeedForwardController::names(const std::vector<const char *> &interfaces) const
{
    std::vector<std::string> all;
    for (const char *interface : interfaces) {
        for (const std::string &joint : joints_) {
            all.push_back(joint + "/" + interface);
        }
    }
    return all;
}

controller_interface::InterfaceConfiguration FeedForwardController::command_interface_configuration() const
{
    return {controller_interface::interface_configuration_type::INDIVIDUAL, names({HW_IF_EFFORT})};
}

controller_interface::InterfaceConfiguration FeedForwardController::state_interface_configuration() const
{
    return {controller_interface::interface_configuration_type::INDIVIDUAL, names({HW_IF_POSITION, HW_IF_VELOCITY})};
}

std::vector<hardware_interface::CommandInterface::SharedPtr>
FeedForwardController::on_export_reference_interfaces_list()
{
    std::vector<hardware_interface::CommandInterface::SharedPtr> all;
    for (const char *interface : {HW_IF_POSITION, HW_IF_VELOCITY, HW_IF_ACCELERATION}) {
        for (const std::string &joint : joints_) {
            all.push_back(std::make_shared<hardware_interface::CommandInterface>(
                std::string(get_node()->get_name()) + "/" + joint, interface));
        }
    }
    return all;
}

std::vector<hardware_interface::StateInterface::SharedPtr> FeedForwardController::on_export_state_interfaces_list()
{
    return {std::make_shared<hardware_interface::StateInterface>(
        std::string(get_node()->get_name()) + "/errors", "count")};
}

CallbackReturn FeedForwardController::on_activate(const rclcpp_lifecycle::State &)
{
    const std::size_t n = joints_.size();
    if (command_interfaces_.size() != n || state_interfaces_.size() != 2 * n) {
        RCLCPP_ERROR(get_node()->get_logger(), "expected an effort, a position and a velocity of each of %zu joints", n);
        return CallbackReturn::ERROR;
    }
    if (!read_measured()) {
        RCLCPP_ERROR(get_node()->get_logger(), "positions and velocities of all joints must be known at the start");
        return CallbackReturn::ERROR;
    }
    predictor_->reset();
    errors_ = 0;
    errors_in_a_row_ = 0;
    show_errors();
    wanted_.q = measured_.q;
    hold();
    return CallbackReturn::SUCCESS;
}

CallbackReturn FeedForwardController::on_deactivate(const rclcpp_lifecycle::State &)
{
    for (auto &command : command_interfaces_) {
        (void)command.set_value(0.0);
    }
    if (errors_ > 0) {
        RCLCPP_WARN(get_node()->get_logger(), "%llu updates with an error", static_cast<unsigned long long>(errors_));
    }
    return CallbackReturn::SUCCESS;
}

/// Whoever wrote references may stop in the midst of a motion: the arm then stays where it was wanted last.
bool FeedForwardController::on_set_chained_mode(bool chained)
{
    if (!chained) {
        hold();
    }
    return true;
}

/// The wanted motion is the last wanted position, at rest.
void FeedForwardController::hold()
{
    const std::size_t n = joints_.size();
    std::fill(wanted_.dq.begin(), wanted_.dq.end(), 0.0);
    std::fill(wanted_.ddq.begin(), wanted_.ddq.end(), 0.0);
    for (std::size_t k = 0; k < ordered_exported_reference_interfaces_.size(); ++k) {
        (void)ordered_exported_reference_interfaces_[k]->set_value(k < n ? wanted_.q[k] : 0.0);
    }
}

/// There is no topic: references come from another controller, or the arm is held.
return_type FeedForwardController::update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &)
{
    return return_type::OK;
}

bool FeedForwardController::read_measured()
{
    const std::size_t n = joints_.size();
    bool good = true;
    for (std::size_t joint = 0; joint < n; ++joint) {
        good = read(state_interfaces_[joint], measured_.q[joint]) && good;
        good = read(state_interfaces_[n + joint], measured_.dq[joint]) && good;
    }
    return good;
}

bool FeedForwardController::read_wanted()
{
    const std::size_t n = joints_.size();
    const auto &all = ordered_exported_reference_interfaces_;
    bool good = true;
    for (std::size_t joint = 0; joint < n; ++joint) {
        // Without a wanted position it stays; without a wanted velocity or acceleration it is at rest.
        good = read(*all[joint], wanted_.q[joint]) && good;
        wanted_.dq[joint] = wanted_.ddq[joint] = 0.0;
        good = read(*all[n + joint], wanted_.dq[joint]) && good;
        good = read(*all[2 * n + joint], wanted_.ddq[joint]) && good;
    }
    return good;
}

bool FeedForwardController::write()
{
    bool good = true;
    for (std::size_t joint = 0; joint < joints_.size(); ++joint) {
        const double feedback = position_gains_[joint] * (wanted_.q[joint] - measured_.q[joint]) +
                                velocity_gains_[joint] * (wanted_.dq[joint] - measured_.dq[joint]);
        const double effort = std::clamp(effort_[joint] + feedback, -limits_[joint], limits_[joint]);
        good = command_interfaces_[joint].set_value(effort) && good;
    }
    return good;
}

void FeedForwardController::show_errors()
{
    for (auto &count : ordered_exported_state_interfaces_) {
        (void)count->set_value(static_cast<double>(errors_));
    }
}

return_type FeedForwardController::update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration &period)
{
    // All of them, whichever fails.
    bool good = read_measured();
    good = read_wanted() && good;
    // As long after the last one as it is; the fallback if the model refuses the sample.
    const auto &[q, dq, ddq] = wanted_;
    good = predictor_->try_torque_after(period.seconds(), q, dq, ddq, effort_) == SGPR_OK && good;
    good = write() && good;
    if (good) {
        errors_in_a_row_ = 0;
        return return_type::OK;
    }
    ++errors_;
    ++errors_in_a_row_;
    show_errors();
    return errors_in_a_row_ < most_errors_ ? return_type::OK : return_type::ERROR;
}

}  // namespace sgpr_feed_forward_controller

PLUGINLIB_EXPORT_CLASS(
    sgpr_feed_forward_controller::FeedForwardController, controller_interface::ChainableControllerInterface)
