"""The aided INS filter's state as flat arrays: where everything lies, how an error is taken out, how two states differ.

One vector x holds the nominal state and the bookkeeping, so that a filter is saved and resumed as bytes. The error
state has n elements: phi (3, n frame, rad), dv (3, NED m/s), dr (3, NED m), then the parameters that are estimated, in
the order of their slots; error = estimate - truth, C_hat = (I - [phi x]) C. `ie[slot]` is the place of a parameter in
the error state, or -1: then the parameter keeps its value (a lever arm that is known, say).
"""

from __future__ import annotations

import math

from numba import njit

from .rotation import quat_product, rotate_state_quat, rotvec_from_quat, wrap_pi

# --- nominal state (x) -------------------------------------------------------------------------------------------
QUAT, VEL, LAT, LON, HGT, PAR = 0, 4, 7, 8, 9, 10
# --- parameters: slot s lies in x[PAR + s] and, where it is estimated, in the error state at ie[s] -------------------
BG, BA, SG, SA = 0, 3, 6, 9  # biases and scales of gyros and accelerometers (3 each)
MG, MA = 12, 18  # misalignments of gyros and accelerometers: xy xz yx yz zx zy
MNT = 24  # roll, pitch, yaw from b to the vehicle's own axes: v_vehicle = Rz Ry Rx v_b
ANT, DVL, SPD = 27, 30, 33  # arms from the IMU in b
TG, TV, TD, TS = 36, 37, 38, 39  # delays of fix, GNSS velocity, DVL, speed: a row stamped t belongs to t - delay
KS, CUR, GB, HB, DB = 40, 41, 43, 46, 47  # log of speed scale, current N E, fix error NED, height offset, depth zero
KD, DM, HO, MB = 48, 49, 52, 53  # DVL scale, DVL misalignment, heading offset, magnetometer bias
KR, RB, USER = 56, 57, 58  # log of range scale, range bias, four for sensors of the user's own
SLOTS = 62
NOMINAL = PAR + SLOTS
# --- bookkeeping (x) ---------------------------------------------------------------------------------------------
T, TROW, TNODE, TQ = (
    NOMINAL,
    NOMINAL + 1,
    NOMINAL + 2,
    NOMINAL + 3,
)  # present, last row, last node; dt of decay and noise
W, F = NOMINAL + 4, NOMINAL + 7  # corrected rate of b against i and specific force, of the last interval, in b
ACC = NOMINAL + 10  # acceleration in n, the mean of the last tenths of a second
WIN = NOMINAL + 13  # w_in (3), then radii + height, gravity, cos(lat)
RN, RE, GRAV, CLAT = NOMINAL + 16, NOMINAL + 17, NOMINAL + 18, NOMINAL + 19
WRAW, FRAW, DTRAW = NOMINAL + 20, NOMINAL + 23, NOMINAL + 26  # last row as measured and its interval
WSLOPE, FSLOPE = NOMINAL + 27, NOMINAL + 30  # slopes of rate and force over the present row
ROWS, HEAD = NOMINAL + 33, NOMINAL + 34  # rows seen; where the ring of past states is written next
DISP, DVI = NOMINAL + 35, NOMINAL + 38  # integrals of velocity and of acceleration since the start (3 each, NED)
TNHC, TSTILL = NOMINAL + 41, NOMINAL + 42  # last vehicle constraint, last zero velocity
STILL_S = NOMINAL + 43  # how long the vehicle has stood
BADH, BADV, BADS = (
    NOMINAL + 44,
    NOMINAL + 45,
    NOMINAL + 46,
)  # since when fixes (level, height), GNSS velocity are refused
TOLD = NOMINAL + 47  # last fix that was believed
COUNTH = NOMINAL + 48  # fixes refused in a row
HARD = NOMINAL + 49  # wild measurements in a row, of each kind (kernels.aided_measure)
NEXT = NOMINAL + 69  # when the next row of the solution is due
WMEAN = NOMINAL + 70  # mean measured rate of the last tenths of a second
TSEEN = NOMINAL + 73  # last fix that came, believed or not
NX = NOMINAL + 74
KEPT = NOMINAL + 20  # what a node keeps of x: the nominal state and the Earth at it

PHI, DV, DR, NAV = 0, 3, 6, 9  # error state

# --- configuration (c) -------------------------------------------------------------------------------------------
ARW2, VRW2 = 0, 3  # squared random walks per axis in b (3 each)
ISO = 6  # 1: all axes alike
GAP_S, GAP_W, GAP_A = 7, 8, 9  # a longer interval is a gap, in which rate and acceleration are unknown by this much
NHC_DT, NHC_Y, NHC_Z, NHC, SLIP = 10, 11, 12, 13, 16  # constraint: every, sigma right, sigma down, point (3), slip
STILL_DT, ZUPT, ZARU = 17, 18, 19  # standing: every, sigma of velocity, sigma of rate
DISTRUST_S, EARLY_S = 20, 21  # how long fixes may be refused
GATE, OPEN_LOOP = 22, 23
RELATIVE = 24  # the speed table is through 0 ground, 1 water or air
DECL, MAG_STD = 25, 26
FOCAL, U0, V0, CAM, C_CB = 27, 28, 29, 30, 33  # camera: focal length px, principal point, arm (3), C_cb (9)
NODE_DT = 42
T0 = 43
SWAY_Y, SWAY_Z = 44, 45  # constraint: angles that a body on springs and tyres yaws and pitches by, rad
LID, REACH, DIVERGENCE, GROUND = 46, 49, 50, 51  # lidar: arm (3), how far it sees, angle of its beam; sigma of ground
HELD = 52  # height and v_down: 0 free, 1 held and out of the error state, 2 held, zeroed in the estimate only
AHEAD, V_AHEAD = 53, 54  # by how much fixes and GNSS velocities were put later than their stamps (delays below 0)
NC = 55

RING = 1024
RING_W = 14  # time, displacement (3), velocity integral (3), quaternion (4), rate (3)


@njit(cache=True, error_model="numpy")
def correct(x, ie, d):
    """Takes an error d (n) out of the nominal state: the truth, were d the error."""
    rotate_state_quat(x, QUAT, d[0], d[1], d[2])
    x[VEL] -= d[3]
    x[VEL + 1] -= d[4]
    x[VEL + 2] -= d[5]
    x[LAT] -= d[6] / x[RN]
    x[LON] = wrap_pi(x[LON] - d[7] / (x[RE] * x[CLAT]))
    x[HGT] += d[8]
    for s in range(SLOTS):
        if ie[s] >= 0:
            x[PAR + s] -= d[ie[s]]


@njit(cache=True, error_model="numpy")
def difference(a, b, ie, d):
    """d (n) = a [-] b: the error of a if b were the truth; undoes `correct`."""
    e0, e1, e2, e3 = quat_product(
        b[QUAT], b[QUAT + 1], b[QUAT + 2], b[QUAT + 3], a[QUAT], -a[QUAT + 1], -a[QUAT + 2], -a[QUAT + 3]
    )
    d[0], d[1], d[2] = rotvec_from_quat(e0, e1, e2, e3)
    d[3] = a[VEL] - b[VEL]
    d[4] = a[VEL + 1] - b[VEL + 1]
    d[5] = a[VEL + 2] - b[VEL + 2]
    d[6] = (a[LAT] - b[LAT]) * a[RN]
    d[7] = wrap_pi(a[LON] - b[LON]) * a[RE] * a[CLAT]
    d[8] = b[HGT] - a[HGT]
    for s in range(SLOTS):
        if ie[s] >= 0:
            d[ie[s]] = a[PAR + s] - b[PAR + s]


@njit(cache=True, error_model="numpy")
def put(H, row, column, value):
    """Adds to H where the parameter is estimated."""
    if column >= 0:
        H[row, column] += value


@njit(cache=True, error_model="numpy")
def put3(H, row, column, a, b, c):
    """Adds three neighbours to H where the parameter is estimated."""
    if column >= 0:
        H[row, column] += a
        H[row, column + 1] += b
        H[row, column + 2] += c


@njit(cache=True, error_model="numpy")
def inverse3(a, b, c, d, e, f, g, h, i):
    """Inverse of a 3x3 matrix given and returned row by row."""
    A, B, C = e * i - f * h, c * h - b * i, b * f - c * e
    k = 1.0 / (a * A + d * B + g * C)
    return (
        k * A, k * B, k * C,
        k * (f * g - d * i), k * (a * i - c * g), k * (c * d - a * f),
        k * (d * h - e * g), k * (b * g - a * h), k * (a * e - b * d),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def mounting(x):
    """Rows of Rz(yaw) Ry(pitch) Rx(roll), row by row: b to the vehicle's own axes."""
    r, p, y = x[PAR + MNT], x[PAR + MNT + 1], x[PAR + MNT + 2]
    sr, cr, sp, cp, sy, cy = math.sin(r), math.cos(r), math.sin(p), math.cos(p), math.sin(y), math.cos(y)
    return (
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr,
    )  # fmt: skip
