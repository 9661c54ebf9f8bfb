// Effort of a torque model, and of feedback, for ros2_control.
#ifndef SGPR_FEED_FORWARD_CONTROLLER__FEED_FORWARD_CONTROLLER_HPP_
#define SGPR_FEED_FORWARD_CONTROLLER__FEED_FORWARD_CONTROLLER_HPP_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "hardware_interface/handle.hpp"
#include "rclcpp/duration.hpp"
#include "rclcpp/time.hpp"
#include "rclcpp_lifecycle/state.hpp"
#include "sgpr.hpp"

namespace sgpr_feed_forward_controller {

/// effort = model(q*, dq*, ddq*) + K (q* - q) + D (dq* - dq), within limits.
///
/// Wanted positions, velocities and accelerations (*) are reference interfaces, which a trajectory controller writes;
/// without one the arm is held where it was wanted last. Interfaces and arrays are in the order of the model's joints.
///
/// An update takes no memory, waits for nothing and writes no log. What goes wrong in it is counted in the state
/// interface `CONTROLLER/errors/count`: a number that is missing or not finite is replaced by the last good one, a
/// sample that the model refuses by its last torque or none. After `most_errors` such updates in a row the controller
/// gives up.
class FeedForwardController : public controller_interface::ChainableControllerInterface {
public:
    controller_interface::CallbackReturn on_init() override;
    controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State &previous) override;
    controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State &previous) override;
    controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State &previous) override;
    controller_interface::InterfaceConfiguration command_interface_configuration() const override;
    controller_interface::InterfaceConfiguration state_interface_configuration() const override;

protected:
    std::vector<hardware_interface::CommandInterface::SharedPtr> on_export_reference_interfaces_list() override;
    std::vector<hardware_interface::StateInterface::SharedPtr> on_export_state_interfaces_list() override;
    bool on_set_chained_mode(bool chained) override;
    controller_interface::return_type update_reference_from_subscribers(
        const rclcpp::Time &time, const rclcpp::Duration &period) override;
    controller_interface::return_type update_and_write_commands(
        const rclcpp::Time &time, const rclcpp::Duration &period) override;

private:
    /// Position, velocity and, of what is wanted, acceleration of all joints.
    struct Motion {
        std::vector<double> q, dq, ddq;
    };

    std::vector<double> per_joint(const std::string &parameter) const;
    std::vector<std::string> names(const std::vector<const char *> &interfaces) const;
    bool read_measured();
    bool read_wanted();
    bool write();
    void hold();
    void show_errors();

    std::vector<std::string> joints_;
    std::optional<sgpr::Predictor> predictor_;
    Motion measured_, wanted_;
    std::vector<double> position_gains_, velocity_gains_, limits_;
    std::vector<double> effort_;
    std::int64_t most_errors_ = 0;
    std::int64_t errors_in_a_row_ = 0;
    std::uint64_t errors_ = 0;
};

}  // namespace sgpr_feed_forward_controller

#endif  // SGPR_FEED_FORWARD_CONTROLLER__FEED_FORWARD_CONTROLLER_HPP_
