/*
 * Torque models of robot arms in a controller. Made by cbindgen: change the source, not this file.
 *
 * A model is read from a file that `sgpr identify`, `sgpr learn` or Model.save wrote. A predictor gives the torque of
 * one sample after the other and carries the hidden states of friction, lags and delays from call to call.
 *
 * Errors: functions return SGPR_OK or what is wrong; sgpr_last_error says it in words. A call that fails changes
 * nothing, but for the torque of a refused sample (sgpr_predictor_set_fallback). No function throws or aborts.
 *
 * Threads: a model never changes and may be used by many threads at once. A predictor belongs to one thread at a time.
 * sgpr_last_error is that of the calling thread. After a predictor is made nothing allocates, waits or calls the system,
 * unless the model has effects of its own making that do.
 *
 * Units: rad, rad/s, rad/s^2, N m; m, m/s, m/s^2, N for joints that slide. Arrays have one number per joint, in the
 * order of sgpr_model_joint_name; `joints` is their length, which is checked.
 */

#ifndef SGPR_H
#define SGPR_H

#include <stddef.h>
#include <stdint.h>

/*
 Grows when a function changes or goes away: compare it with sgpr_abi_version().
 */
#define SGPR_ABI_VERSION 1

/*
 All went well.
 */
#define SGPR_OK 0

/*
 A pointer that must not be NULL is.
 */
#define SGPR_NULL_POINTER 1

/*
 An array of another length than the model has joints.
 */
#define SGPR_WRONG_LENGTH 2

/*
 A number of a sample that is not finite.
 */
#define SGPR_NOT_FINITE 3

/*
 A time between samples that is zero, negative or too short, a time that runs backwards.
 */
#define SGPR_BAD_TIME 4

/*
 An effect needs the temperature of its joint: sgpr_predictor_set_temperature.
 */
#define SGPR_NO_TEMPERATURE 5

/*
 A file that is not there, is no model, or is that of a newer version.
 */
#define SGPR_BAD_MODEL 6

/*
 An option that is none, a rate that an effect needs, or a standard deviation of a model or
 predictor without one.
 */
#define SGPR_BAD_OPTION 7

/*
 A model with an effect that cannot be advanced sample by sample, or a Gaussian process that
 cannot be asked.
 */
#define SGPR_NOT_STREAMED 8

/*
 A mistake in the library: please report it.
 */
#define SGPR_INTERNAL 9

/*
 No good sample yet, of which something could be said.
 */
#define SGPR_NO_SAMPLE 10

/*
 The torque that the arm needs: without errors of the measurement and what was there for a while.
 */
#define SGPR_FEED_FORWARD 0

/*
 The torque that a log would show.
 */
#define SGPR_EXPECTED_MEASUREMENT 1

/*
 The torque of a refused sample is the last good one, zero before the first.
 */
#define SGPR_LAST_TORQUE 0

/*
 The torque of a refused sample is zero.
 */
#define SGPR_ZERO_TORQUE 1

/*
 A model.
 */
typedef struct sgpr_model sgpr_model;

/*
 The torque of one sample after the other.
 */
typedef struct sgpr_predictor sgpr_predictor;

/*
 How a predictor is made. All zero (`sgpr_options options = {0};`) is a feed-forward without a
 rate.
 */
typedef struct sgpr_options {
    /*
     Calls per second, 0 if not known; effects of time, delays and lags need it.
     */
    double rate_hz;
    /*
     SGPR_FEED_FORWARD or SGPR_EXPECTED_MEASUREMENT.
     */
    int32_t purpose;
    /*
     1: every call computes the standard deviation of its torque, too, for which a learned model
     needs a square of its points in memory, and as much time. 0: none does.
     */
    int32_t deviation;
    /*
     Names of effects that a feed-forward leaves out and that are wanted all the same, as a
     payload that is carried; UTF-8, may be NULL.
     */
    const char *const *keep;
    /*
     How many names there are.
     */
    size_t keep_length;
} sgpr_options;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/*
 SGPR_ABI_VERSION of the library.
 */
uint32_t sgpr_abi_version(void);

/*
 Version of the library, as "0.1.0".
 */
const char *sgpr_version(void);

/*
 What went wrong in the last call of this thread that failed; valid until the next one that does.
 Never NULL.
 */
const char *sgpr_last_error(void);

/*
 Reads a model. `path` is UTF-8.

 # Safety
 `path` is NULL or a C string; `model` is NULL or may be written.
 */
int32_t sgpr_model_load(const char *path, struct sgpr_model **model);

/*
 Reads a model from the content of a file.

 # Safety
 `bytes` is NULL or has `length` bytes; `model` is NULL or may be written.
 */
int32_t sgpr_model_from_bytes(const uint8_t *bytes, size_t length, struct sgpr_model **model);

/*
 Frees a model; predictors of it stay valid.

 # Safety
 `model` is NULL or was made here, and is not used again.
 */
void sgpr_model_free(struct sgpr_model *model);

/*
 Number of joints; 0 for NULL.

 # Safety
 `model` is NULL or was made here.
 */
size_t sgpr_model_joints(const struct sgpr_model *model);

/*
 Name of a joint, UTF-8, valid as long as the model; NULL if there is none.

 # Safety
 `model` is NULL or was made here.
 */
const char *sgpr_model_joint_name(const struct sgpr_model *model, size_t joint);

/*
 Whether the model has Gaussian processes of what its physics leaves over, so that its torques
 have a standard deviation: 1 or 0; 0 for NULL.

 # Safety
 `model` is NULL or was made here.
 */
int32_t sgpr_model_learned(const struct sgpr_model *model);

/*
 Makes a predictor of a model; hidden states start at rest at the first sample.

 rate_hz: calls per second, 0 if not known; effects of time, delays and lags need it.
 purpose: SGPR_FEED_FORWARD leaves out errors of the measurement and what was there for a while,
 SGPR_EXPECTED_MEASUREMENT nothing.

 # Safety
 `model` is NULL or was made here; `predictor` is NULL or may be written.
 */
int32_t sgpr_predictor_new(const struct sgpr_model *model,
                           double rate_hz,
                           int32_t purpose,
                           struct sgpr_predictor **predictor);

/*
 Makes a predictor of a model with all options; SGPR_BAD_OPTION if it is to say how sure its
 torques are and the model has not learned that (sgpr_model_learned).

 # Safety
 `model` is NULL or was made here; `options` is NULL or has as many names as it says; `predictor`
 is NULL or may be written.
 */
int32_t sgpr_predictor_new_with(const struct sgpr_model *model,
                                const struct sgpr_options *options,
                                struct sgpr_predictor **predictor);

/*
 Frees a predictor.

 # Safety
 `predictor` is NULL or was made here, and is not used again.
 */
void sgpr_predictor_free(struct sgpr_predictor *predictor);

/*
 Number of joints; 0 for NULL.

 # Safety
 `predictor` is NULL or was made here.
 */
size_t sgpr_predictor_joints(const struct sgpr_predictor *predictor);

/*
 Samples refused since the predictor was made; 0 for NULL.

 # Safety
 `predictor` is NULL or was made here.
 */
uint64_t sgpr_predictor_refused(const struct sgpr_predictor *predictor);

/*
 What the torque is when a sample is refused: SGPR_LAST_TORQUE (at first) or SGPR_ZERO_TORQUE.

 # Safety
 `predictor` is NULL or was made here, and no other thread uses it meanwhile.
 */
int32_t sgpr_predictor_set_fallback(struct sgpr_predictor *predictor, int32_t fallback);

/*
 Forgets all samples: hidden states start at rest at the next one, the clock is at zero.

 # Safety
 `predictor` is NULL or was made here, and no other thread uses it meanwhile.
 */
int32_t sgpr_predictor_reset(struct sgpr_predictor *predictor);

/*
 Forgets all samples: hidden states are those after a long motion at speed dq to q, the clock is
 at zero.

 # Safety
 `predictor` is NULL or was made here, and no other thread uses it meanwhile; arrays are NULL or
 have `joints` numbers.
 */
int32_t sgpr_predictor_reset_at(struct sgpr_predictor *predictor, const double *q, const double *dq, size_t joints);

/*
 Sets the time of the session at the next sample, s.

 # Safety
 `predictor` is NULL or was made here, and no other thread uses it meanwhile.
 */
int32_t sgpr_predictor_set_time(struct sgpr_predictor *predictor, double time);

/*
 Sets the temperature of each joint, degrees Celsius.

 # Safety
 `predictor` is NULL or was made here, and no other thread uses it meanwhile; the array is NULL
 or has `joints` numbers.
 */
int32_t sgpr_predictor_set_temperature(struct sgpr_predictor *predictor, const double *celsius, size_t joints);

/*
 Torque at the next sample, one period after the last. If a number is not finite or a temperature
 is missing, the sample is refused and counted, tau is as the fallback says, and hidden states
 stay as they are.

 # Safety
 `predictor` is NULL or was made here, and no other thread uses it meanwhile; arrays are NULL or
 have `joints` numbers.
 */
int32_t sgpr_predictor_torque(struct sgpr_predictor *predictor,
                              const double *q,
                              const double *dq,
                              const double *ddq,
                              double *tau,
                              size_t joints);

/*
 Torque `step` seconds after the last sample: for irregular calls and pauses.

 # Safety
 As [`sgpr_predictor_torque`].
 */
int32_t sgpr_predictor_torque_after(struct sgpr_predictor *predictor,
                                    double step,
                                    const double *q,
                                    const double *dq,
                                    const double *ddq,
                                    double *tau,
                                    size_t joints);

/*
 Torque at a time of a clock, s, which must be later than at the sample before. The first sample
 sets the clock.

 # Safety
 As [`sgpr_predictor_torque`].
 */
int32_t sgpr_predictor_torque_at(struct sgpr_predictor *predictor,
                                 double time,
                                 const double *q,
                                 const double *dq,
                                 const double *ddq,
                                 double *tau,
                                 size_t joints);

/*
 Standard deviation of the measured torque about the last good one, `[n]`, N m (N): of the
 Gaussian processes, of noise, and of what uncertain parameters bring. Of a predictor made with
 `deviation`.

 # Safety
 `predictor` is NULL or was made here, and no other thread uses it meanwhile; the array is NULL
 or has `joints` numbers.
 */
int32_t sgpr_predictor_deviation(const struct sgpr_predictor *predictor, double *deviation, size_t joints);

/*
 Share of the variance of each joint's process that its logs have not explained at the last good
 sample, `[n]`: from 0 at a point of the logs to 1 far from all, 0 for a joint without a process.
 Above 0.95 the torque is that of the physics. Of a predictor made with `deviation`.

 # Safety
 `predictor` is NULL or was made here, and no other thread uses it meanwhile; the array is NULL
 or has `joints` numbers.
 */
int32_t sgpr_predictor_novelty(const struct sgpr_predictor *predictor, double *novelty, size_t joints);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* SGPR_H */
