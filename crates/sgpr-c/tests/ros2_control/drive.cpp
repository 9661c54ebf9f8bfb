// Runs the controller of examples/ros2_control as a controller manager does, beside a predictor and a feedback of its
// own.
// argv: model.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

#include "sgpr_feed_forward_controller/feed_forward_controller.hpp"

extern "C" void *__libc_malloc(std::size_t size);

namespace {
unsigned long taken;
}

// Seen by the library, too.
extern "C" void *malloc(std::size_t size) noexcept
{
    ++taken;
    return __libc_malloc(size);
}

namespace {

using controller_interface::CallbackReturn;
using controller_interface::return_type;
using sgpr_feed_forward_controller::FeedForwardController;

constexpr double kPeriod = 0.004, kStiffness = 50.0, kDamping = 5.0, kLimit = 25.0;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
int failures;

void expect(bool holds, const char *what)
{
    if (!holds) {
        std::fprintf(stderr, "does not hold: %s\n", what);
        ++failures;
    }
}

/// The controller with the hardware below and the references above it.
struct Arm {
    FeedForwardController controller;
    std::vector<hardware_interface::CommandInterface::SharedPtr> efforts, references;
    std::vector<hardware_interface::StateInterface::SharedPtr> states, errors;
    std::size_t n = 0;

    explicit Arm(const std::string &model)
    {
        auto &parameters = controller.get_node()->parameters;
        parameters = {{"model", model},
                      {"position_gains", std::vector<double>{kStiffness}},
                      {"velocity_gains", std::vector<double>{kDamping}},
                      {"effort_limits", std::vector<double>{kLimit}},
                      {"keep", std::vector<std::string>{""}},
                      {"most_errors", std::int64_t{3}},
                      {"joint_prefix", std::string("left_")}};
        expect(controller.on_init() == CallbackReturn::SUCCESS, "init");
    }

    CallbackReturn configure() { return controller.on_configure({}); }

    /// What a manager does between the configuration and the activation.
    void connect()
    {
        references = controller.export_reference_interfaces();
        errors = controller.export_state_interfaces();
        std::vector<hardware_interface::LoanedCommandInterface> commands;
        std::vector<hardware_interface::LoanedStateInterface> measured;
        for (const std::string &name : controller.command_interface_configuration().names) {
            efforts.push_back(std::make_shared<hardware_interface::CommandInterface>(name, ""));
            commands.emplace_back(efforts.back());
        }
        for (const std::string &name : controller.state_interface_configuration().names) {
            states.push_back(std::make_shared<hardware_interface::StateInterface>(name, ""));
            measured.emplace_back(states.back());
        }
        controller.assign_interfaces(std::move(commands), std::move(measured));
        n = efforts.size();
    }

    return_type update(double period = kPeriod) { return controller.update({}, rclcpp::Duration(period)); }
    double count() const { return errors[0]->get_optional().value_or(-1.0); }
    const std::string &said() { return controller.get_node()->get_logger().last; }
};

template <typename Interfaces>
void set(const Interfaces &interfaces, std::size_t first, const std::vector<double> &values)
{
    for (std::size_t k = 0; k < values.size(); ++k) {
        expect(interfaces[first + k]->set_value(values[k]), "set");
    }
}

bool efforts_are(const Arm &arm, const std::vector<double> &wanted)
{
    for (std::size_t k = 0; k < arm.n; ++k) {
        if (arm.efforts[k]->get_optional() != wanted[k]) {
            return false;
        }
    }
    return true;
}

void refuses_bad_parameters(const std::string &model)
{
    const auto says = [&](const char *name, const rclcpp::Value &value, const char *words) {
        Arm arm(model);
        arm.controller.get_node()->parameters[name] = value;
        expect(arm.configure() == CallbackReturn::ERROR && arm.said().find(words) != std::string::npos, name);
    };
    says("model", std::string("/no/such.sgpr"), "/no/such.sgpr");
    says("position_gains", std::vector<double>{1.0, 2.0}, "position_gains");
    says("velocity_gains", std::vector<double>{-1.0}, "velocity_gains");
    says("effort_limits", std::vector<double>{kNan}, "effort_limits");
    says("fallback", std::string("none"), "fallback");
    says("keep", std::vector<std::string>{"no_such_effect"}, "no_such_effect");
}

/// The motion at a step: of every joint another one.
std::vector<double> wave(std::size_t n, int step, int derivative)
{
    std::vector<double> values(n);
    for (std::size_t k = 0; k < n; ++k) {
        const double w = 1.0 + 0.3 * static_cast<double>(k), t = kPeriod * step;
        values[k] = derivative == 0 ? std::sin(w * t) : derivative == 1 ? w * std::cos(w * t) : -w * w * std::sin(w * t);
    }
    return values;
}

std::vector<double> with_feedback(std::vector<double> tau, const std::vector<double> &q_error,
                                  const std::vector<double> &dq_error)
{
    for (std::size_t k = 0; k < tau.size(); ++k) {
        tau[k] = std::min(kLimit, std::max(-kLimit, tau[k] + (kStiffness * q_error[k] + kDamping * dq_error[k])));
    }
    return tau;
}

void follows(Arm &arm, sgpr::Predictor &own)
{
    const std::size_t n = arm.n;
    std::vector<double> tau(n), q_error(n), dq_error(n);
    bool limited = false;
    for (int step = 0; step < 1500; ++step) {
        const std::vector<double> q = wave(n, step, 0), dq = wave(n, step, 1), ddq = wave(n, step, 2);
        std::vector<double> measured_q = q, measured_dq = dq;
        for (std::size_t k = 0; k < n; ++k) {
            measured_q[k] += 0.01 * std::sin(5.0 * step);
            measured_dq[k] -= 0.1 * std::cos(3.0 * step);
            q_error[k] = q[k] - measured_q[k];
            dq_error[k] = dq[k] - measured_dq[k];
        }
        set(arm.references, 0, q);
        set(arm.references, n, dq);
        set(arm.references, 2 * n, ddq);
        set(arm.states, 0, measured_q);
        set(arm.states, n, measured_dq);
        const unsigned long before = taken;
        const return_type done = arm.update();
        const unsigned long after = taken;
        own.torque_after(kPeriod, q, dq, ddq, tau);
        const std::vector<double> wanted = with_feedback(tau, q_error, dq_error);
        for (const double effort : wanted) {
            limited = limited || std::abs(effort) == kLimit;
        }
        if (done != return_type::OK || after != before || !efforts_are(arm, wanted)) {
            expect(after == before, "no memory in an update");
            expect(false, "effort of the model and of feedback");
            return;
        }
    }
    expect(limited, "some effort at its limit");
    expect(arm.count() == 0.0, "no error");
}

void bears_errors(Arm &arm, sgpr::Predictor &own)
{
    const std::size_t n = arm.n;
    const std::vector<double> q = wave(n, 1499, 0), zero(n, 0.0);
    std::vector<double> tau(n);
    set(arm.states, 0, q);
    set(arm.states, n, zero);
    // References that are none: where it was, at rest.
    set(arm.references, 0, std::vector<double>(3 * n, kNan));
    expect(arm.update() == return_type::OK && arm.count() == 1.0, "an error is counted");
    own.torque_after(kPeriod, q, zero, zero, tau);
    expect(efforts_are(arm, with_feedback(tau, zero, zero)), "held without references");
    // A time that does not pass: the last torque of the model.
    set(arm.references, 0, q);
    set(arm.references, n, std::vector<double>(2 * n, 0.0));
    expect(arm.update(0.0) == return_type::OK && arm.count() == 2.0, "a step without time is counted");
    expect(efforts_are(arm, with_feedback(tau, zero, zero)), "the last torque");
    expect(arm.update() == return_type::OK, "good again");
    // A state that somebody else locks, for too long.
    arm.states[0]->locked = true;
    expect(arm.update() == return_type::OK && arm.update() == return_type::OK, "two errors");
    expect(arm.update() == return_type::ERROR && arm.count() == 5.0, "three in a row are too many");
    arm.states[0]->locked = false;
    arm.efforts[0]->locked = true;
    expect(arm.update() != return_type::ERROR || arm.count() == 6.0, "an effort that is not taken");
    arm.efforts[0]->locked = false;
    expect(arm.update() == return_type::OK && arm.count() == 6.0, "good again");
}

void holds_when_left_alone(Arm &arm)
{
    const std::size_t n = arm.n;
    set(arm.references, 0, std::vector<double>(n, 0.25));
    set(arm.references, n, std::vector<double>(2 * n, 0.5));
    expect(arm.update() == return_type::OK, "moving");
    arm.controller.set_chained_mode(false);
    for (std::size_t k = 0; k < 3 * n; ++k) {
        expect(arm.references[k]->get_optional() == (k < n ? 0.25 : 0.0), "held where it was wanted last");
    }
    expect(arm.update() == return_type::OK, "alone");
}

}  // namespace

int main(int count, char **arguments)
{
    if (count != 2) {
        return 2;
    }
    refuses_bad_parameters(arguments[1]);
    Arm arm(arguments[1]);
    expect(arm.configure() == CallbackReturn::SUCCESS, "configure");
    expect(arm.controller.on_activate({}) == CallbackReturn::ERROR, "nothing without interfaces");
    arm.connect();
    const sgpr::Model model(arguments[1]);
    const std::size_t n = model.joints();
    expect(arm.n == n && arm.states.size() == 2 * n && arm.references.size() == 3 * n, "interfaces of all joints");
    expect(arm.efforts[0]->get_name() == "left_" + model.joint_names()[0] + "/effort/", "names");
    expect(arm.references[n]->get_name() == "feed_forward/left_" + model.joint_names()[0] + "/velocity", "references");
    expect(arm.controller.on_activate({}) == CallbackReturn::ERROR, "nothing without measured positions");
    set(arm.states, 0, std::vector<double>(2 * n, 0.0));
    arm.controller.set_chained_mode(true);
    expect(arm.controller.on_activate({}) == CallbackReturn::SUCCESS, "activate");
    sgpr::Predictor own(model, 250.0);
    follows(arm, own);
    bears_errors(arm, own);
    holds_when_left_alone(arm);
    expect(arm.controller.on_deactivate({}) == CallbackReturn::SUCCESS, "deactivate");
    expect(efforts_are(arm, std::vector<double>(n, 0.0)), "no effort at the end");
    expect(arm.said().find("6 updates") != std::string::npos, "errors are told");
    return failures == 0 ? 0 : 1;
}
