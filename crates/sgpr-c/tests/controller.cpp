// The same controller in C++17. argv: model, motion, torques to write, number of joints.
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "sgpr.hpp"

namespace {

std::vector<double> torques(const sgpr::Model &model, const std::vector<double> &motion)
{
    sgpr::Predictor predictor(model, 250.0, sgpr::Purpose::expected_measurement);
    const std::size_t n = predictor.joints();
    std::vector<double> all(motion.size() / 3);
    for (std::size_t k = 0; k + n <= all.size(); k += n) {
        const double *sample = motion.data() + 3 * k;
        const sgpr::View<const double> q(sample, n), dq(sample + n, n), ddq(sample + 2 * n, n);
        predictor.torque(q, dq, ddq, sgpr::View<double>(all.data() + k, n));
    }
    return all;
}

bool refuses(sgpr::Predictor &predictor)
{
    std::vector<double> q(predictor.joints(), 0.1), bad(predictor.joints(), std::nan("")), tau(predictor.joints());
    const std::vector<double> fixed = q;
    predictor.torque(fixed, q, q, tau);
    std::array<double, 1> one{0.0};
    if (predictor.try_torque(q, one, q, tau) != SGPR_WRONG_LENGTH) {
        return false;
    }
    try {
        predictor.torque(q, q, bad, tau);
    } catch (const sgpr::Error &error) {
        return error.code == SGPR_NOT_FINITE && std::string(error.what()).find("ddq") != std::string::npos &&
               predictor.refused() == 1;
    }
    return false;
}

} // namespace

int main(int count, char **arguments)
{
    if (count != 5) {
        return 2;
    }
    try {
        const sgpr::Model model(arguments[1]);
        if (model.joints() != std::stoul(arguments[4]) || model.joint_names().size() != model.joints()) {
            return 3;
        }
        std::vector<double> motion;
        std::FILE *in = std::fopen(arguments[2], "rb");
        if (in == nullptr) {
            return 2;
        }
        for (double value; std::fread(&value, sizeof value, 1, in) == 1;) {
            motion.push_back(value);
        }
        std::fclose(in);
        // One model, a predictor for each thread.
        std::vector<std::vector<double>> all(4);
        std::vector<std::thread> threads;
        for (auto &own : all) {
            threads.emplace_back([&model, &motion, &own] { own = torques(model, motion); });
        }
        for (auto &thread : threads) {
            thread.join();
        }
        for (const auto &own : all) {
            if (own != all[0]) {
                return 4;
            }
        }
        sgpr::Predictor predictor(model, 250.0);
        if (!refuses(predictor)) {
            return 5;
        }
        std::FILE *out = std::fopen(arguments[3], "wb");
        if (out == nullptr || std::fwrite(all[0].data(), sizeof(double), all[0].size(), out) != all[0].size()) {
            return 2;
        }
        return std::fclose(out);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
