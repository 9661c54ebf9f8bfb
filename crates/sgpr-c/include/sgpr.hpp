// Torque models of robot arms in a controller in C++17: sgpr.h with owners, views and exceptions.
#ifndef SGPR_HPP
#define SGPR_HPP

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "sgpr.h"

namespace sgpr {

/// What a call refused; `code` is one of SGPR_....
class Error : public std::runtime_error {
public:
    explicit Error(std::int32_t code) : std::runtime_error(sgpr_last_error()), code(code) {}
    std::int32_t code;
};

inline void check(std::int32_t code)
{
    if (code != SGPR_OK) {
        throw Error(code);
    }
}

/// Numbers that somebody else owns: made of anything with data() and size(), as std::array, std::vector, std::span.
template <typename T>
class View {
public:
    constexpr View(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
    template <std::size_t N>
    constexpr View(T (&array)[N]) noexcept : data_(array), size_(N) {}
    template <typename Container, typename = decltype(std::declval<Container &>().data())>
    constexpr View(Container &&container) noexcept : data_(container.data()), size_(container.size()) {}
    constexpr T *data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }

private:
    T *data_;
    std::size_t size_;
};

/// A model; never changes, may be used by many threads.
class Model {
public:
    explicit Model(const std::string &path)
    {
        sgpr_model *model = nullptr;
        check(sgpr_model_load(path.c_str(), &model));
        model_.reset(model);
    }

    std::size_t joints() const noexcept { return sgpr_model_joints(model_.get()); }

    /// Whether its torques have a standard deviation: that of Gaussian processes.
    bool learned() const noexcept { return sgpr_model_learned(model_.get()) != 0; }

    std::vector<std::string> joint_names() const
    {
        std::vector<std::string> names;
        for (std::size_t joint = 0; joint < joints(); ++joint) {
            names.emplace_back(sgpr_model_joint_name(model_.get(), joint));
        }
        return names;
    }

    const sgpr_model *get() const noexcept { return model_.get(); }

private:
    struct Free {
        void operator()(sgpr_model *model) const noexcept { sgpr_model_free(model); }
    };
    std::unique_ptr<sgpr_model, Free> model_;
};

enum class Purpose : std::int32_t {
    feed_forward = SGPR_FEED_FORWARD,
    expected_measurement = SGPR_EXPECTED_MEASUREMENT,
};

/// How a predictor is made: sgpr_options with owners.
struct Options {
    /// Calls per second, 0 if not known; effects of time, delays and lags need it.
    double rate_hz = 0.0;
    Purpose purpose = Purpose::feed_forward;
    /// Whether every call computes the standard deviation of its torque, too; learned models alone have one.
    bool deviation = false;
    /// Effects that a feed-forward leaves out and that are wanted all the same, as a payload that is carried.
    std::vector<std::string> keep{};
};

/// Torque of one sample after the other; belongs to one thread at a time. What begins with `try_` throws nothing: for
/// the loop.
class Predictor {
public:
    Predictor(const Model &model, const Options &options)
    {
        std::vector<const char *> keep;
        for (const std::string &name : options.keep) {
            keep.push_back(name.c_str());
        }
        const sgpr_options plain{options.rate_hz, static_cast<std::int32_t>(options.purpose), options.deviation ? 1 : 0,
                                 keep.data(), keep.size()};
        sgpr_predictor *predictor = nullptr;
        check(sgpr_predictor_new_with(model.get(), &plain, &predictor));
        predictor_.reset(predictor);
    }

    Predictor(const Model &model, double rate_hz, Purpose purpose = Purpose::feed_forward)
        : Predictor(model, Options{rate_hz, purpose})
    {
    }

    std::size_t joints() const noexcept { return sgpr_predictor_joints(predictor_.get()); }
    std::uint64_t refused() const noexcept { return sgpr_predictor_refused(predictor_.get()); }
    void set_fallback(std::int32_t fallback) { check(sgpr_predictor_set_fallback(predictor_.get(), fallback)); }
    void reset() { check(sgpr_predictor_reset(predictor_.get())); }
    void set_time(double time) { check(sgpr_predictor_set_time(predictor_.get(), time)); }

    void reset(View<const double> q, View<const double> dq)
    {
        same(q.size(), dq.size());
        check(sgpr_predictor_reset_at(predictor_.get(), q.data(), dq.data(), q.size()));
    }

    void set_temperature(View<const double> celsius)
    {
        check(sgpr_predictor_set_temperature(predictor_.get(), celsius.data(), celsius.size()));
    }

    /// One period after the last sample.
    void torque(View<const double> q, View<const double> dq, View<const double> ddq, View<double> tau)
    {
        check(try_torque(q, dq, ddq, tau));
    }

    /// `step` seconds after the last sample.
    void torque_after(double step, View<const double> q, View<const double> dq, View<const double> ddq, View<double> tau)
    {
        check(try_torque_after(step, q, dq, ddq, tau));
    }

    /// At a time of a clock, s.
    void torque_at(double time, View<const double> q, View<const double> dq, View<const double> ddq, View<double> tau)
    {
        check(try_torque_at(time, q, dq, ddq, tau));
    }

    std::int32_t try_torque(View<const double> q, View<const double> dq, View<const double> ddq,
                            View<double> tau) noexcept
    {
        return sgpr_predictor_torque(predictor_.get(), q.data(), dq.data(), ddq.data(), tau.data(),
                                     length(q, dq, ddq, tau));
    }

    std::int32_t try_torque_after(double step, View<const double> q, View<const double> dq, View<const double> ddq,
                                  View<double> tau) noexcept
    {
        return sgpr_predictor_torque_after(predictor_.get(), step, q.data(), dq.data(), ddq.data(), tau.data(),
                                           length(q, dq, ddq, tau));
    }

    std::int32_t try_torque_at(double time, View<const double> q, View<const double> dq, View<const double> ddq,
                               View<double> tau) noexcept
    {
        return sgpr_predictor_torque_at(predictor_.get(), time, q.data(), dq.data(), ddq.data(), tau.data(),
                                        length(q, dq, ddq, tau));
    }

    /// Standard deviation of the measured torque about the last good one, N m (N).
    void deviation(View<double> to) const { check(try_deviation(to)); }

    std::int32_t try_deviation(View<double> to) const noexcept
    {
        return sgpr_predictor_deviation(predictor_.get(), to.data(), to.size());
    }

    /// How far the last good sample is from all that the processes have seen, 0 to 1.
    void novelty(View<double> to) const { check(try_novelty(to)); }

    std::int32_t try_novelty(View<double> to) const noexcept
    {
        return sgpr_predictor_novelty(predictor_.get(), to.data(), to.size());
    }

private:
    /// That of the first array of another length than the model has joints, which is refused; else that of all.
    std::size_t length(View<const double> q, View<const double> dq, View<const double> ddq,
                       View<double> tau) const noexcept
    {
        const std::size_t n = joints();
        for (const std::size_t size : {q.size(), dq.size(), ddq.size(), tau.size()}) {
            if (size != n) {
                return size;
            }
        }
        return n;
    }

    static void same(std::size_t a, std::size_t b)
    {
        if (a != b) {
            throw std::invalid_argument("arrays of different lengths");
        }
    }

    struct Free {
        void operator()(sgpr_predictor *predictor) const noexcept { sgpr_predictor_free(predictor); }
    };
    std::unique_ptr<sgpr_predictor, Free> predictor_;
};

} // namespace sgpr

#endif // SGPR_HPP
