"""Numbers printed in the thesis, with the tables they stand in."""

import numpy as np

# Table C-1: a_1 to a_4 and b_1 to b_4 of the PUMA 560, a row per harmonic, a column per joint, rad/s.
PUMA_A = np.array(
    [
        [0.88, 1.20, 0.0008, -0.28, -0.09, -1.44],
        [0.26, -0.13, 0.0006, 0.41, -0.026, 0.19],
        [-0.54, 0.41, 0.066, -0.88, -0.86, 0.26],
        [-0.76, 0.21, 0.11, -0.99, -0.22, -1.0],
    ]
)
PUMA_B = np.array(
    [
        [-0.57, 0.27, -0.63, 0.24, 0.75, 0.091],
        [0.26, 0.28, -0.30, -0.067, 0.74, 1.33],
        [0.23, -1.89, 0.56, 0.92, 0.20, 1.08],
        [0.11, -0.29, 0.17, 0.44, -0.44, -0.54],
    ]
)

# Table C-2: the same of the two-link arm, three harmonics.
TWO_LINK_A = np.array([[0.15, -0.25], [-2.80e-5, -6.59e-5], [-0.21, 0.22]])
TWO_LINK_B = np.array([[8.96e-5, 0.00021], [0.0648, 0.029], [-5.04e-5, -0.00011]])

FUNDAMENTAL_HZ = 0.1

# Section 5-3-1: condition number of the observation matrix of the measured motion.
MEASURED_CONDITION = {"puma560": 52.47, "two_link": 8.78}

# Tables 5-4 and 5-5, rad/s².
MAX_ACCELERATION = {"puma560": 6.0, "two_link": 2.0}

# Tables 5-6 and 5-7: proportional and derivative gain of every joint.
IDENTIFICATION_GAINS = (75.0, 0.32)
TEST_GAINS = (10.0, 0.2)

# Section 5-4: base parameters of the two-link arm, and those of its wrong internal model (eq. 5-7).
TRUE_BASE = np.array([1.25, -0.5, 0.0, 0.5])
WRONG_BASE = np.array([2.25, -1.5, 1.0, 1.5])

# Section 5-3-3: closed-loop bandwidth of the PUMA 560, up to which the high-frequency series goes.
BANDWIDTH_HZ = 5.0

# Table 5-8: mean RMSE of the position of joints 1 to 6 over three test trajectories; unit not printed.
TABLE_5_8 = {
    "cond(W_fe)": [0.16, 0.46, 0.35, 0.203, 0.236, 0.082],
    "cond(W_nfe)": [1.203, 2.09, 0.606, 0.373, 0.53, 0.71],
    "HFS + cond(W_fe)": [0.21, 2.12, 0.44, 0.203, 0.23, 0.113],
    "HFS + cond(W_nfe)": [0.183, 0.386, 0.353, 0.22, 0.243, 0.099],
    "sum cond(W_fe)": [0.166, 0.386, 0.233, 0.223, 0.31, 0.088],
    "sum cond(W_nfe)": [1.053, 1.94, 0.51, 0.29, 0.43, 0.503],
    "HFS + sum cond(W_fe)": [0.243, 1.98, 0.406, 0.22, 0.32, 0.1066],
    "HFS + sum cond(W_nfe)": [0.2, 0.33, 0.35, 0.22, 0.323, 0.17],
}
