/*
 * After set-up a predictor takes and gives back no memory and calls the system never, whether a sample is good or
 * refused, at the rate or at times of a clock, and whether it is asked how sure its torque is. argv: model, motion,
 * torques to write (not written), number of joints.
 */
#define _GNU_SOURCE
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "sgpr.h"

#define MOST 16
#define CALLS 20000

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *memory, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);
extern void __libc_free(void *memory);

static unsigned long taken, given_back;

/* The loader gives these to the library, too. */
void *malloc(size_t size)
{
    ++taken;
    return __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    ++taken;
    return __libc_calloc(count, size);
}

void *realloc(void *memory, size_t size)
{
    ++taken;
    return __libc_realloc(memory, size);
}

int posix_memalign(void **memory, size_t alignment, size_t size)
{
    ++taken;
    *memory = __libc_memalign(alignment, size);
    return *memory == NULL;
}

void *aligned_alloc(size_t alignment, size_t size)
{
    ++taken;
    return __libc_memalign(alignment, size);
}

void *memalign(size_t alignment, size_t size)
{
    ++taken;
    return __libc_memalign(alignment, size);
}

void free(void *memory)
{
    given_back += memory != NULL;
    __libc_free(memory);
}

/* From here on any system call but the end of the process kills it: one for memory, one to wait for a lock, any. */
static int forbid_system_calls(void)
{
    struct sock_filter rules[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_exit_group, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
    };
    struct sock_fprog program = {sizeof rules / sizeof *rules, rules};
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0;
}

/* Calls of a predictor in every way; 0 if each ended as it must. */
static int run(sgpr_predictor *predictor, int deviation)
{
    double q[MOST], dq[MOST], ddq[MOST], tau[MOST], sure[MOST];
    const size_t n = sgpr_predictor_joints(predictor);
    size_t j;
    int k;
    for (k = 0; k < CALLS; ++k) {
        const double t = 0.004 * k;
        const int bad = k % 100 == 7;
        int32_t found;
        for (j = 0; j < n; ++j) {
            q[j] = sin(t * (double)(j + 1));
            dq[j] = (double)(j + 1) * cos(t * (double)(j + 1));
            ddq[j] = bad ? NAN : 0.1;
        }
        switch (k % 3) {
        case 0: found = sgpr_predictor_torque(predictor, q, dq, ddq, tau, n); break;
        case 1: found = sgpr_predictor_torque_after(predictor, 0.005, q, dq, ddq, tau, n); break;
        default: found = sgpr_predictor_torque_at(predictor, 1.0 + t, q, dq, ddq, tau, n); break;
        }
        if (found != (bad ? SGPR_NOT_FINITE : SGPR_OK)) {
            return 1;
        }
        if (deviation && (sgpr_predictor_deviation(predictor, sure, n) != SGPR_OK ||
                          sgpr_predictor_novelty(predictor, sure, n) != SGPR_OK)) {
            return 1;
        }
        if (sgpr_predictor_torque(predictor, q, NULL, ddq, tau, n) != SGPR_NULL_POINTER) {
            return 1;
        }
        if (k % 1000 == 999 && sgpr_predictor_reset(predictor) != SGPR_OK) {
            return 1;
        }
    }
    return 0;
}

int main(int count, char **arguments)
{
    sgpr_model *model = NULL;
    sgpr_predictor *predictor = NULL, *sure = NULL;
    sgpr_options options = {0};
    unsigned long before, before_given;
    int wrong;
    options.rate_hz = 250.0;
    options.purpose = SGPR_EXPECTED_MEASUREMENT;
    if (count != 5 || sgpr_model_load(arguments[1], &model) != SGPR_OK ||
        sgpr_predictor_new_with(model, &options, &predictor) != SGPR_OK) {
        fprintf(stderr, "%s\n", sgpr_last_error());
        return 1;
    }
    options.deviation = 1;
    if (sgpr_model_learned(model) && sgpr_predictor_new_with(model, &options, &sure) != SGPR_OK) {
        fprintf(stderr, "%s\n", sgpr_last_error());
        return 1;
    }
    if (sgpr_predictor_joints(predictor) > MOST || taken == 0 || given_back == 0) {
        return 2; /* set-up takes memory: else the count sees nothing */
    }
    if (forbid_system_calls()) {
        return 77;
    }
    before = taken;
    before_given = given_back;
    wrong = run(predictor, 0) || (sure != NULL && run(sure, 1));
    if (wrong) {
        _exit(3);
    }
    _exit(taken == before && given_back == before_given ? 0 : 4);
}
