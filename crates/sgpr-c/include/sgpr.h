/*
 * Torque models of robot arms in a controller.
 *
 * A model is read from a file that `sgpr identify` or Model.save wrote. A predictor gives the torque of one sample after
 * the other and carries the hidden states of friction, lags and delays from call to call.
 *
 * Errors: functions return SGPR_OK or what is wrong; sgpr_last_error says it in words. A call that fails changes
 * nothing, but for the torque of a refused sample (sgpr_predictor_set_fallback). No function throws or aborts.
 *
 * Threads: a model never changes and may be used by many threads at once. A predictor belongs to one thread at a time.
 * sgpr_last_error is that of the calling thread. After sgpr_predictor_new nothing allocates, waits or calls the system,
 * unless the model has effects of its own making that do.
 *
 * Units: rad, rad/s, rad/s^2, N m; m, m/s, m/s^2, N for joints that slide. Arrays have one number per joint, in the
 * order of sgpr_model_joint_name; `joints` is their length, which is checked.
 */
#ifndef SGPR_H
#define SGPR_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Grows when a function changes or goes away: compare it with sgpr_abi_version(). */
#define SGPR_ABI_VERSION 1

/* What functions return. */
#define SGPR_OK 0
#define SGPR_NULL_POINTER 1
#define SGPR_WRONG_LENGTH 2
#define SGPR_NOT_FINITE 3
/* A time between samples that is zero, negative or too short, a time that runs backwards. */
#define SGPR_BAD_TIME 4
#define SGPR_NO_TEMPERATURE 5
/* A file that is not there, is no model, or is that of a newer version. */
#define SGPR_BAD_MODEL 6
/* A rate, a purpose or a fallback that is none, or a rate that an effect needs. */
#define SGPR_BAD_OPTION 7
/* A model with an effect that cannot be advanced sample by sample. */
#define SGPR_NOT_STREAMED 8
/* A mistake in the library: please report it. */
#define SGPR_INTERNAL 9

/* What the torque is for. */
#define SGPR_FEED_FORWARD 0
#define SGPR_EXPECTED_MEASUREMENT 1

/* What the torque is when a sample is refused. */
#define SGPR_LAST_TORQUE 0
#define SGPR_ZERO_TORQUE 1

typedef struct sgpr_model sgpr_model;
typedef struct sgpr_predictor sgpr_predictor;

uint32_t sgpr_abi_version(void);

/* Version of the library, as "0.1.0". */
const char *sgpr_version(void);

/* What went wrong in the last call of this thread that failed; valid until the next one that does. Never NULL. */
const char *sgpr_last_error(void);

/* Reads a model. `path` is UTF-8. */
int32_t sgpr_model_load(const char *path, sgpr_model **model);

/* The same from the content of a file. */
int32_t sgpr_model_from_bytes(const uint8_t *bytes, size_t length, sgpr_model **model);

/* NULL is allowed. Predictors of the model stay valid. */
void sgpr_model_free(sgpr_model *model);

/* Number of joints; 0 for NULL. */
size_t sgpr_model_joints(const sgpr_model *model);

/* Name of a joint, UTF-8, valid as long as the model; NULL if there is none. */
const char *sgpr_model_joint_name(const sgpr_model *model, size_t joint);

/*
 * A predictor of a model; hidden states start at rest at the first sample.
 *
 * rate_hz: calls per second, 0 if not known; effects of time, delays and lags need it.
 * purpose: SGPR_FEED_FORWARD leaves out errors of the measurement and what was there for a while.
 */
int32_t sgpr_predictor_new(const sgpr_model *model, double rate_hz, int32_t purpose, sgpr_predictor **predictor);

/* NULL is allowed. */
void sgpr_predictor_free(sgpr_predictor *predictor);

/* Number of joints; 0 for NULL. */
size_t sgpr_predictor_joints(const sgpr_predictor *predictor);

/* SGPR_LAST_TORQUE (the default; zero before the first good sample) or SGPR_ZERO_TORQUE. */
int32_t sgpr_predictor_set_fallback(sgpr_predictor *predictor, int32_t fallback);

/* Samples refused since the predictor was made; 0 for NULL. */
uint64_t sgpr_predictor_refused(const sgpr_predictor *predictor);

/* Forgets all samples: hidden states start at rest at the next one, the clock is at zero. */
int32_t sgpr_predictor_reset(sgpr_predictor *predictor);

/* The same, but hidden states are those after a long motion at speed dq to q. */
int32_t sgpr_predictor_reset_at(sgpr_predictor *predictor, const double *q, const double *dq, size_t joints);

/* Time of the session at the next sample, s. */
int32_t sgpr_predictor_set_time(sgpr_predictor *predictor, double time);

/* Temperature of each joint, degrees Celsius. */
int32_t sgpr_predictor_set_temperature(sgpr_predictor *predictor, const double *celsius, size_t joints);

/*
 * Torque at the next sample, one period after the last. If a number is not finite or a temperature is missing, the
 * sample is refused and counted, tau is as the fallback says, and hidden states stay as they are.
 */
int32_t sgpr_predictor_torque(sgpr_predictor *predictor, const double *q, const double *dq, const double *ddq, double *tau,
                              size_t joints);

/* The same, `step` seconds after the last sample: for irregular calls and pauses. */
int32_t sgpr_predictor_torque_after(sgpr_predictor *predictor, double step, const double *q, const double *dq,
                                    const double *ddq, double *tau, size_t joints);

/* The same at a time of a clock, s, which must be later than at the sample before. The first sample sets the clock. */
int32_t sgpr_predictor_torque_at(sgpr_predictor *predictor, double time, const double *q, const double *dq,
                                 const double *ddq, double *tau, size_t joints);

#ifdef __cplusplus
}
#endif

#endif /* SGPR_H */
