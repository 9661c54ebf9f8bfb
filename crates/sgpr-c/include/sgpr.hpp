// Torque models of robot arms in a controller in C++17: sgpr.h with owners, views and exceptions.
#ifndef SGPR_HPP
#define SGPR_HPP

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
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

/// Torque of one sample after the other; belongs to one thread at a time. `try_torque` throws nothing: for the loop.
class Predictor {
public:
    Predictor(const Model &model, double rate_hz, Purpose purpose = Purpose::feed_forward)
    {
        sgpr_predictor *predictor = nullptr;
        check(sgpr_predictor_new(model.get(), rate_hz, static_cast<std::int32_t>(purpose), &predictor));
        predictor_.reset(predictor);
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

    void torque(View<const double> q, View<const double> dq, View<const double> ddq, View<double> tau)
    {
        check(try_torque(q, dq, ddq, tau));
    }

    std::int32_t try_torque(View<const double> q, View<const double> dq, View<const double> ddq,
                            View<double> tau) noexcept
    {
        const std::size_t n = joints();
        if (dq.size() != n || ddq.size() != n || tau.size() != n) {
            return sgpr_predictor_torque(predictor_.get(), q.data(), dq.data(), ddq.data(), tau.data(), n + 1);
        }
        return sgpr_predictor_torque(predictor_.get(), q.data(), dq.data(), ddq.data(), tau.data(), q.size());
    }

private:
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
