// MuJoCo's mj_step (Euler) on the PUMA 560 of mujoco_puma.py under PD control at 1 kHz, steps at 4 kHz: nanoseconds per
// step, fastest of many batches.
// Build: cc -O3 mujoco_step.c -I$WHEEL/include $WHEEL/libmujoco.so.* -Wl,-rpath,$WHEEL -lm; run: ./a.out MODEL.mjb...
#include <math.h>
#include <mujoco/mujoco.h>
#include <stdio.h>
#include <time.h>

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(int argc, char** argv) {
  for (int file = 1; file < argc; ++file) {
    mjModel* m = mj_loadModel(argv[file], NULL);
    mjData* d = mj_makeData(m);
    double best = 1e9;
    for (int batch = 0; batch < 40; ++batch) {
      mj_resetData(m, d);
      double start = now();
      for (int step = 0; step < 4000; ++step) {
        if (step % 4 == 0) {
          for (int i = 0; i < 6; ++i) {
            double q = 0.5 * sin((i + 1) * d->time), dq = 0.5 * (i + 1) * cos((i + 1) * d->time);
            d->ctrl[i] = 300 * (q - d->qpos[i]) + 10 * (dq - d->qvel[i]);
          }
        }
        mj_step(m, d);
      }
      double each = (now() - start) / 4000 * 1e9;
      if (each < best) best = each;
    }
    printf("%s: %.0f ns per step, q1 = %.6f\n", argv[file], best, d->qpos[0]);
    mj_deleteData(d);
    mj_deleteModel(m);
  }
  return 0;
}
