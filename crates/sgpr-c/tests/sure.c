/*
 * Torques of a learned model and how sure they are. argv: model, motion, numbers to write, number of joints. Of each
 * sample the torques, their standard deviations and the novelties are written; every third comes after 8 ms.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "expect.h"
#include "sgpr.h"

#define MOST 16

static void wrong_use(sgpr_predictor *predictor, size_t n)
{
    double zero[MOST] = {0.0}, bad[MOST] = {0.0}, tau[MOST], sure[MOST], again[MOST];
    bad[n - 1] = INFINITY;
    expect(sgpr_predictor_deviation(predictor, sure, n), SGPR_NO_SAMPLE, "no good sample");
    expect(sgpr_predictor_torque(predictor, bad, zero, zero, tau, n), SGPR_NOT_FINITE, "q");
    expect(sgpr_predictor_novelty(predictor, sure, n), SGPR_NO_SAMPLE, "no good sample");
    expect(sgpr_predictor_torque(predictor, zero, zero, zero, tau, n), SGPR_OK, "");
    expect(sgpr_predictor_deviation(predictor, NULL, n), SGPR_NULL_POINTER, "deviation");
    expect(sgpr_predictor_novelty(predictor, NULL, n), SGPR_NULL_POINTER, "novelty");
    expect(sgpr_predictor_deviation(predictor, sure, n + 1), SGPR_WRONG_LENGTH, "joints");
    expect(sgpr_predictor_deviation(predictor, sure, n), SGPR_OK, "");
    /* A refused sample leaves them at those of the last good one. */
    expect(sgpr_predictor_torque(predictor, bad, zero, zero, tau, n), SGPR_NOT_FINITE, "q");
    expect(sgpr_predictor_deviation(predictor, again, n), SGPR_OK, "");
    expect(memcmp(sure, again, n * sizeof *sure), 0, "");
    expect(sgpr_predictor_reset(predictor), SGPR_OK, "");
    expect(sgpr_predictor_deviation(predictor, sure, n), SGPR_NO_SAMPLE, "no good sample");
}

int main(int count, char **arguments)
{
    sgpr_model *model = NULL;
    sgpr_predictor *predictor = NULL;
    sgpr_options options = {0};
    double sample[3 * MOST], numbers[3 * MOST];
    FILE *in, *out;
    size_t n, k;
    if (count != 5) {
        return 2;
    }
    n = (size_t)atoi(arguments[4]);
    options.rate_hz = 250.0;
    options.purpose = SGPR_EXPECTED_MEASUREMENT;
    options.deviation = 1;
    expect(sgpr_model_load(arguments[1], &model), SGPR_OK, "");
    expect(sgpr_model_learned(model), 1, "");
    expect(sgpr_predictor_new_with(model, &options, &predictor), SGPR_OK, "");
    sgpr_model_free(model);
    wrong_use(predictor, n);
    in = fopen(arguments[2], "rb");
    out = fopen(arguments[3], "wb");
    if (in == NULL || out == NULL) {
        return 2;
    }
    for (k = 0; fread(sample, sizeof *sample, 3 * n, in) == 3 * n; ++k) {
        const double *q = sample, *dq = sample + n, *ddq = sample + 2 * n;
        expect(k % 3 == 2 ? sgpr_predictor_torque_after(predictor, 0.008, q, dq, ddq, numbers, n)
                          : sgpr_predictor_torque(predictor, q, dq, ddq, numbers, n),
               SGPR_OK, "");
        expect(sgpr_predictor_deviation(predictor, numbers + n, n), SGPR_OK, "");
        expect(sgpr_predictor_novelty(predictor, numbers + 2 * n, n), SGPR_OK, "");
        if (fwrite(numbers, sizeof *numbers, 3 * n, out) != 3 * n) {
            return 2;
        }
    }
    sgpr_predictor_free(predictor);
    (void)fclose(in);
    return fclose(out) == 0 && failures == 0 ? 0 : 1;
}
