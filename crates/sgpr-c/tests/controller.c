/* A controller in C, and everything that it may do wrong. argv: model, motion, torques to write, number of joints. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "expect.h"
#include "sgpr.h"

#define MOST 16

static void wrong_options(const sgpr_model *model, size_t n)
{
    const char *unknown[] = {"payload"}, *missing[] = {NULL}, *latin[] = {"\xff"}, *lag[] = {"actuator_lag"};
    sgpr_options options = {0};
    sgpr_predictor *predictor = NULL;
    double sure[MOST] = {0.0};
    expect(sgpr_predictor_new_with(model, NULL, &predictor), SGPR_NULL_POINTER, "options");
    expect(sgpr_predictor_new_with(NULL, &options, &predictor), SGPR_NULL_POINTER, "model");
    expect(sgpr_predictor_new_with(model, &options, NULL), SGPR_NULL_POINTER, "predictor");
    options.rate_hz = 250.0;
    options.deviation = 1;
    expect(sgpr_model_learned(model), 0, "");
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_BAD_OPTION, "no Gaussian processes");
    options.deviation = 2;
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_BAD_OPTION, "deviation");
    options.deviation = 0;
    options.keep_length = 1;
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_NULL_POINTER, "keep");
    options.keep = missing;
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_NULL_POINTER, "keep");
    options.keep = latin;
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_BAD_OPTION, "UTF-8");
    options.keep = unknown;
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_BAD_OPTION, "payload");
    options.keep_length = (size_t)-1;
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_WRONG_LENGTH, "keep_length");
    expect(predictor != NULL, 0, "");
    options.keep = lag;
    options.keep_length = 1;
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_OK, "");
    expect(sgpr_predictor_deviation(predictor, sure, n), SGPR_BAD_OPTION, "without a standard deviation");
    expect(sgpr_predictor_novelty(predictor, sure, n), SGPR_BAD_OPTION, "without a standard deviation");
    expect(sgpr_predictor_novelty(NULL, sure, n), SGPR_NULL_POINTER, "predictor");
    sgpr_predictor_free(predictor);
}

static void wrong_use(const char *path, size_t n)
{
    sgpr_model *model = NULL;
    sgpr_predictor *predictor = NULL;
    double good[MOST] = {0.0}, bad[MOST] = {0.0}, tau[MOST] = {0.0}, first[MOST];
    size_t k;
    bad[0] = NAN;
    for (k = 0; k < n; ++k) {
        good[k] = 0.3;
    }
    expect(sgpr_model_load(NULL, &model), SGPR_NULL_POINTER, "path");
    expect(sgpr_model_load(path, NULL), SGPR_NULL_POINTER, "model");
    expect(sgpr_model_load("/no/such/file.sgpr", &model), SGPR_BAD_MODEL, "/no/such/file.sgpr");
    expect(sgpr_model_load("\xff.sgpr", &model), SGPR_BAD_MODEL, "UTF-8");
    expect(sgpr_model_from_bytes((const uint8_t *)"nonsense", 8, &model), SGPR_BAD_MODEL, "bytes");
    expect(model != NULL, 0, "");
    expect(sgpr_predictor_new(NULL, 100.0, SGPR_FEED_FORWARD, &predictor), SGPR_NULL_POINTER, "model");
    expect(sgpr_model_load(path, &model), SGPR_OK, "");
    expect(sgpr_predictor_new(model, 100.0, SGPR_FEED_FORWARD, NULL), SGPR_NULL_POINTER, "predictor");
    expect(sgpr_predictor_new(model, -1.0, SGPR_FEED_FORWARD, &predictor), SGPR_BAD_OPTION, "rate_hz");
    expect(sgpr_predictor_new(model, NAN, SGPR_FEED_FORWARD, &predictor), SGPR_BAD_OPTION, "rate_hz");
    expect(sgpr_predictor_new(model, 0.0, SGPR_EXPECTED_MEASUREMENT, &predictor), SGPR_BAD_OPTION, "actuator_lag");
    expect(sgpr_predictor_new(model, 100.0, 7, &predictor), SGPR_BAD_OPTION, "purpose");
    expect(sgpr_predictor_new(model, 100.0, SGPR_FEED_FORWARD, &predictor), SGPR_OK, "");
    expect(sgpr_predictor_torque(NULL, good, good, good, tau, n), SGPR_NULL_POINTER, "predictor");
    expect(sgpr_predictor_torque(predictor, NULL, good, good, tau, n), SGPR_NULL_POINTER, "q");
    expect(sgpr_predictor_torque(predictor, good, good, good, NULL, n), SGPR_NULL_POINTER, "tau");
    expect(sgpr_predictor_torque(predictor, good, good, good, tau, n - 1), SGPR_WRONG_LENGTH, "joints");
    expect(sgpr_predictor_set_fallback(predictor, 5), SGPR_BAD_OPTION, "fallback");
    expect(sgpr_predictor_set_time(predictor, NAN), SGPR_NOT_FINITE, "time");
    expect(sgpr_predictor_torque_at(predictor, 2.0, good, good, good, first, n), SGPR_OK, "");
    expect(sgpr_predictor_torque_at(predictor, 1.0, good, good, good, tau, n), SGPR_BAD_TIME, "time");
    expect(memcmp(first, tau, n * sizeof *tau), 0, "");
    expect(sgpr_predictor_torque_at(predictor, 2.01, good, good, good, tau, n), SGPR_OK, "");
    expect(sgpr_predictor_torque_after(predictor, 0.0, good, good, good, tau, n), SGPR_BAD_TIME, "step");
    expect(sgpr_predictor_set_fallback(predictor, SGPR_ZERO_TORQUE), SGPR_OK, "");
    expect(sgpr_predictor_torque(predictor, good, bad, good, tau, n), SGPR_NOT_FINITE, "dq");
    for (k = 0; k < n; ++k) {
        expect(tau[k] != 0.0, 0, "");
    }
    expect((int32_t)sgpr_predictor_refused(predictor), 3, "");
    expect(sgpr_predictor_reset_at(predictor, bad, good, n), SGPR_NOT_FINITE, "q");
    expect(sgpr_predictor_reset_at(predictor, good, good, n), SGPR_OK, "");
    expect(sgpr_model_joint_name(model, n) != NULL, 0, "");
    wrong_options(model, n);
    sgpr_predictor_free(predictor);
    sgpr_predictor_free(NULL);
    sgpr_model_free(model);
    sgpr_model_free(NULL);
}

int main(int count, char **arguments)
{
    sgpr_model *model = NULL;
    sgpr_predictor *predictor = NULL;
    double sample[3 * MOST], tau[MOST];
    FILE *in, *out;
    size_t n;
    if (count != 5) {
        return 2;
    }
    n = (size_t)atoi(arguments[4]);
    expect((int32_t)sgpr_abi_version(), SGPR_ABI_VERSION, "");
    wrong_use(arguments[1], n);
    expect(sgpr_model_load(arguments[1], &model), SGPR_OK, "");
    expect((int32_t)sgpr_model_joints(model), (int32_t)n, "");
    expect(sgpr_predictor_new(model, 250.0, SGPR_EXPECTED_MEASUREMENT, &predictor), SGPR_OK, "");
    sgpr_model_free(model);
    in = fopen(arguments[2], "rb");
    out = fopen(arguments[3], "wb");
    if (in == NULL || out == NULL) {
        return 2;
    }
    while (fread(sample, sizeof *sample, 3 * n, in) == 3 * n) {
        expect(sgpr_predictor_torque(predictor, sample, sample + n, sample + 2 * n, tau, n), SGPR_OK, "");
        if (fwrite(tau, sizeof *tau, n, out) != n) {
            return 2;
        }
    }
    sgpr_predictor_free(predictor);
    (void)fclose(in);
    return fclose(out) == 0 && failures == 0 ? 0 : 1;
}
