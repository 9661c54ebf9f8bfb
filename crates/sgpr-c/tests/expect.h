/* What a call should return, and what its message should say. */
#ifndef SGPR_TESTS_EXPECT_H
#define SGPR_TESTS_EXPECT_H

#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "sgpr.h"

static int failures;

static void expect(int32_t found, int32_t wanted, const char *words)
{
    if (found != wanted || (wanted != SGPR_OK && strstr(sgpr_last_error(), words) == NULL)) {
        fprintf(stderr, "got %d, wanted %d with \"%s\": %s\n", (int)found, (int)wanted, words, sgpr_last_error());
        failures++;
    }
}

#endif
