// A controller at 1 kHz in closed loop with an arm that MuJoCo moves: torque of a model for the wanted motion, and feedback.
//
//     controller ARM.mjb MODEL.sgpr REFERENCE.bin LOG.bin SEED RIPPLE_JOINT RIPPLE_SIZE RIPPLE_ORDER STIFFNESS...
//
// The arm has what is in its file, friction included, and a ripple of one gear, RIPPLE_SIZE sin(RIPPLE_ORDER q), N·m. The
// reference holds rows of q, dq, ddq, [n] each, one per millisecond; the log rows of q, dq and tau as drives would log them,
// then the error of the position, [n] each. STIFFNESS is the feedback of each joint, N·m/rad.

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <mujoco/mujoco.h>
#include <sgpr.hpp>

namespace {

constexpr double rate_hz = 1000.0;
constexpr double encoder_noise = 2e-5;  // rad
constexpr double torque_noise = 0.02;   // N·m
constexpr double damping_time = 0.05;   // s: damping over stiffness

struct Ripple {
    int joint;
    double size;
    double order;
};

// The arm: a motor torque in, a motion out.
class Arm {
public:
    Arm(const std::string &path, Ripple ripple)
        : model_(mj_loadModel(path.c_str(), nullptr), mj_deleteModel), ripple_(ripple)
    {
        if (!model_) {
            throw std::runtime_error(path + ": MuJoCo cannot read it");
        }
        data_ = {mj_makeData(model_.get()), mj_deleteData};
        steps_ = static_cast<int>(std::lround(1.0 / (rate_hz * model_->opt.timestep)));
    }

    std::size_t joints() const { return static_cast<std::size_t>(model_->nv); }
    const double *q() const { return data_->qpos; }
    const double *dq() const { return data_->qvel; }

    void place(const double *q, const double *dq)
    {
        std::copy(q, q + joints(), data_->qpos);
        std::copy(dq, dq + joints(), data_->qvel);
        mj_forward(model_.get(), data_.get());
    }

    void move(const std::vector<double> &tau)
    {
        for (int step = 0; step < steps_; ++step) {
            std::copy(tau.begin(), tau.end(), data_->qfrc_applied);
            data_->qfrc_applied[ripple_.joint] -= ripple_.size * std::sin(ripple_.order * data_->qpos[ripple_.joint]);
            mj_step(model_.get(), data_.get());
        }
    }

private:
    std::unique_ptr<mjModel, void (*)(mjModel *)> model_;
    std::unique_ptr<mjData, void (*)(mjData *)> data_{nullptr, mj_deleteData};
    Ripple ripple_;
    int steps_ = 1;
};

// Feed-forward of a model at the measured position for the wanted motion, and feedback of the error.
class Controller {
public:
    Controller(const sgpr::Model &model, std::vector<double> stiffness, std::vector<double> damping)
        : predictor_(model, rate_hz), stiffness_(std::move(stiffness)), damping_(std::move(damping)),
          tau_(predictor_.joints())
    {
        if (stiffness_.size() != predictor_.joints()) {
            throw std::runtime_error("one stiffness per joint of the model");
        }
    }

    const std::vector<double> &torque(const std::vector<double> &q, const std::vector<double> &dq, const double *wanted)
    {
        const std::size_t n = q.size();
        const sgpr::View<const double> wanted_dq(wanted + n, n), wanted_ddq(wanted + 2 * n, n);
        predictor_.try_torque(q, wanted_dq, wanted_ddq, tau_);
        for (std::size_t joint = 0; joint < n; ++joint) {
            tau_[joint] += stiffness_[joint] * (wanted[joint] - q[joint]) +
                           damping_[joint] * (wanted[n + joint] - dq[joint]);
        }
        return tau_;
    }

    std::uint64_t refused() const { return predictor_.refused(); }

private:
    sgpr::Predictor predictor_;
    std::vector<double> stiffness_, damping_;
    std::vector<double> tau_;
};

std::vector<double> numbers_of(const std::string &path)
{
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file) {
        throw std::runtime_error(path + ": cannot be read");
    }
    std::vector<double> numbers(static_cast<std::size_t>(file.tellg()) / sizeof(double));
    file.seekg(0);
    file.read(reinterpret_cast<char *>(numbers.data()), static_cast<std::streamsize>(numbers.size() * sizeof(double)));
    return numbers;
}

void run(const std::vector<std::string> &words)
{
    const Ripple ripple{std::stoi(words[5]), std::stod(words[6]), std::stod(words[7])};
    Arm arm(words[0], ripple);
    const std::size_t n = arm.joints();
    const sgpr::Model model(words[1]);
    std::vector<double> stiffness, damping;
    for (std::size_t k = 8; k < words.size(); ++k) {
        stiffness.push_back(std::stod(words[k]));
        damping.push_back(damping_time * stiffness.back());
    }
    if (model.joints() != n || stiffness.size() != n || ripple.joint < 0 || ripple.joint >= static_cast<int>(n)) {
        throw std::runtime_error("arm, model and options are of different numbers of joints");
    }
    Controller controller(model, stiffness, damping);
    const std::vector<double> reference = numbers_of(words[2]);
    const std::size_t samples = reference.size() / (3 * n);

    std::mt19937_64 random(std::stoull(words[4]));
    std::normal_distribution<double> normal;
    std::vector<double> q(n), dq(n), log;
    log.reserve(samples * 4 * n);
    arm.place(reference.data(), reference.data() + n);
    for (std::size_t k = 0; k < samples; ++k) {
        const double *wanted = reference.data() + 3 * n * k;
        for (std::size_t joint = 0; joint < n; ++joint) {
            q[joint] = arm.q()[joint] + encoder_noise * normal(random);
            dq[joint] = arm.dq()[joint];
        }
        const std::vector<double> &tau = controller.torque(q, dq, wanted);
        log.insert(log.end(), q.begin(), q.end());
        log.insert(log.end(), dq.begin(), dq.end());
        for (std::size_t joint = 0; joint < n; ++joint) {
            log.push_back(tau[joint] + torque_noise * normal(random));
        }
        for (std::size_t joint = 0; joint < n; ++joint) {
            log.push_back(wanted[joint] - arm.q()[joint]);
        }
        arm.move(tau);
    }
    if (controller.refused() != 0) {
        throw std::runtime_error("samples were refused");
    }
    std::ofstream file(words[3], std::ios::binary);
    file.write(reinterpret_cast<const char *>(log.data()), static_cast<std::streamsize>(log.size() * sizeof(double)));
    file.flush();
    if (!file) {
        throw std::runtime_error(words[3] + ": cannot be written");
    }
}

} // namespace

int main(int count, char **words)
{
    if (count < 10) {
        std::cerr << "controller ARM.mjb MODEL.sgpr REFERENCE.bin LOG.bin SEED RIPPLE_JOINT RIPPLE_SIZE RIPPLE_ORDER "
                     "STIFFNESS...\n";
        return 2;
    }
    try {
        run({words + 1, words + count});
    } catch (const std::exception &error) {
        std::cerr << error.what() << '\n';
        return 1;
    }
    return 0;
}
