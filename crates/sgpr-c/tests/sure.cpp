// The same as sure.c in C++17. argv: model, motion, numbers to write, number of joints.
#include <cstdio>
#include <string>
#include <vector>

#include "sgpr.hpp"

namespace {

bool refuses(const sgpr::Model &model)
{
    sgpr::Predictor plain(model, 250.0);
    std::vector<double> zero(model.joints()), tau(model.joints()), sure(model.joints()), longer(model.joints() + 1);
    plain.torque(zero, zero, zero, tau);
    if (plain.try_deviation(sure) != SGPR_BAD_OPTION || plain.try_novelty(sure) != SGPR_BAD_OPTION) {
        return false;
    }
    sgpr::Predictor predictor(model, sgpr::Options{250.0, sgpr::Purpose::feed_forward, true});
    if (predictor.try_deviation(sure) != SGPR_NO_SAMPLE) {
        return false;
    }
    predictor.torque_at(3.0, zero, zero, zero, tau);
    predictor.deviation(sure);
    if (predictor.try_torque_at(2.0, zero, zero, zero, tau) != SGPR_BAD_TIME || !(sure.front() > 0.0)) {
        return false;
    }
    try {
        predictor.novelty(longer);
    } catch (const sgpr::Error &error) {
        return error.code == SGPR_WRONG_LENGTH;
    }
    return false;
}

bool unknown_effect_is_named(const sgpr::Model &model)
{
    sgpr::Options options;
    options.keep = {"no_such_effect"};
    try {
        sgpr::Predictor predictor(model, options);
    } catch (const sgpr::Error &error) {
        return error.code == SGPR_BAD_OPTION && std::string(error.what()).find("no_such_effect") != std::string::npos;
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
        const std::size_t n = model.joints();
        if (n != std::stoul(arguments[4]) || !model.learned()) {
            return 3;
        }
        if (!refuses(model) || !unknown_effect_is_named(model)) {
            return 4;
        }
        sgpr::Options options;
        options.rate_hz = 250.0;
        options.purpose = sgpr::Purpose::expected_measurement;
        options.deviation = true;
        sgpr::Predictor predictor(model, options);
        std::FILE *in = std::fopen(arguments[2], "rb"), *out = std::fopen(arguments[3], "wb");
        if (in == nullptr || out == nullptr) {
            return 2;
        }
        std::vector<double> sample(3 * n), numbers(3 * n);
        const sgpr::View<const double> q(sample.data(), n), dq(sample.data() + n, n), ddq(sample.data() + 2 * n, n);
        const sgpr::View<double> tau(numbers.data(), n);
        for (std::size_t k = 0; std::fread(sample.data(), sizeof(double), 3 * n, in) == 3 * n; ++k) {
            if (k % 3 == 2) {
                predictor.torque_after(0.008, q, dq, ddq, tau);
            } else {
                predictor.torque(q, dq, ddq, tau);
            }
            predictor.deviation({numbers.data() + n, n});
            predictor.novelty({numbers.data() + 2 * n, n});
            if (std::fwrite(numbers.data(), sizeof(double), 3 * n, out) != 3 * n) {
                return 2;
            }
        }
        std::fclose(in);
        return std::fclose(out);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
