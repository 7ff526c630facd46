/* Energy, gradient and Hessian of a body of P1 simplices, W(x) = sum over cells of volume * psi(F), for an
 * isotropic psi(s, J) with s = I_C - 3 and J = det F (plane strain in 2D: s = tr F^T F - DIM, J unchanged).
 *
 *     P     = dpsi/dF = 2 psi_s F + psi_J cof F
 *     dP    = 2 psi_s dF + 4 psi_ss (F : dF) F + psi_JJ (cof F : dF) cof F + psi_J d(cof F)
 *
 * Corner a has the constant gradient g_a of its hat function, and g_0 = - sum of the others, so that
 * F = sum_a (x_a - x_0) g_a^T, the force on corner a is f_a = volume P g_a, and the block of the corners a and b of the
 * element's Hessian is
 *
 *     K_ab  = volume [ 2 psi_s (g_a . g_b) I + 4 psi_ss (F g_a)(F g_b)^T + psi_JJ (cof F g_a)(cof F g_b)^T
 *                      + psi_J E(g_a, g_b) ],
 *     E_ik  = eps_ikm (F (g_a x g_b))_m  in 3D,   eps_ik (g_a x g_b)  in 2D.
 *
 * LANES cells are processed at once: every quantity of a group of cells is an array over its lanes, which the
 * compiler turns into vector instructions. psi is linear in both moduli, which are therefore passed multiplied by the
 * volume; the last group is padded with copies of a cell whose moduli are zero.
 *
 * Compiled with -DDIM=2 or 3 and -DDENSITY='"neo_hookean.h"', say, for each use: the header of the material's model in
 * this folder; see library.py.
 */
#include <math.h>
#include <stdint.h>

#define LANES 8
#define CORNERS (DIM + 1)
#define PAIRS (DIM * (DIM + 1) / 2)
#define SQUARE (DIM * DIM)
#define EACH for (int l = 0; l < LANES; l++)

typedef double lanes[LANES];

/* The parts of a body that the kernels read; rest gradients (corner, coordinate), and so on, lane by lane. */
typedef struct {
    int64_t groups;
    const int32_t *corners;   /* (groups, CORNERS, LANES) nodes, ascending over the corners of a cell */
    const int32_t *pairs;     /* (groups, PAIRS, LANES) blocks above the diagonal: corners 01, 02, .. 12, .. */
    const double *gradients;  /* (groups, DIM, DIM, LANES) g_a of all corners except the first [1/m] */
    const double *mu, *lambda;  /* (groups, LANES) moduli times volume [J] */
} Cells;

/* psi(s, J, mu, lambda) and its derivatives psi_s, psi_ss, psi_J, psi_JJ. */
#include DENSITY

/* F and cof F (row by row), s and J of one group, at the positions x (n_nodes, DIM). */
static inline void kinematics(const double *x, const int32_t *corners, const double *g, lanes *F, lanes *C, lanes s,
                              lanes J) {
    for (int c = 0; c < SQUARE; c++) EACH F[c][l] = 0.0;
    for (int i = 0; i < DIM; i++) {
        lanes first, edge;
        EACH first[l] = x[(int64_t)corners[l] * DIM + i];
        for (int a = 0; a < DIM; a++) {
            EACH edge[l] = x[(int64_t)corners[(a + 1) * LANES + l] * DIM + i] - first[l];
            for (int j = 0; j < DIM; j++) EACH F[i * DIM + j][l] += edge[l] * g[(a * DIM + j) * LANES + l];
        }
    }
#if DIM == 3
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int p = (i + 1) % 3, q = (i + 2) % 3, r = (j + 1) % 3, t = (j + 2) % 3;
            EACH C[i * 3 + j][l] = F[p * 3 + r][l] * F[q * 3 + t][l] - F[p * 3 + t][l] * F[q * 3 + r][l];
        }
    EACH J[l] = F[0][l] * C[0][l] + F[1][l] * C[1][l] + F[2][l] * C[2][l];
#else
    EACH { C[0][l] = F[3][l]; C[1][l] = -F[2][l]; C[2][l] = -F[1][l]; C[3][l] = F[0][l]; }
    EACH J[l] = F[0][l] * F[3][l] - F[1][l] * F[2][l];
#endif
    EACH s[l] = -(double)DIM;
    for (int c = 0; c < SQUARE; c++) EACH s[l] += F[c][l] * F[c][l];
}

/* W [J] and, where `gradient` (n_nodes, DIM) is given (zeroed before), dW/dx [N]; least: the smallest J. */
double energy_gradient(const Cells *cells, const double *x, double *gradient, double *least) {
    double energy = 0.0, smallest = INFINITY;
    for (int64_t group = 0; group < cells->groups; group++) {
        const int32_t *corners = cells->corners + group * CORNERS * LANES;
        const double *g = cells->gradients + group * SQUARE * LANES;
        const double *mu = cells->mu + group * LANES, *lambda = cells->lambda + group * LANES;
        lanes F[SQUARE], C[SQUARE], s, J;
        kinematics(x, corners, g, F, C, s, J);
        EACH {
            energy += psi(s[l], J[l], mu[l], lambda[l]);
            smallest = J[l] < smallest || J[l] != J[l] ? J[l] : smallest;
        }
        if (!gradient) continue;
        lanes P[SQUARE], stretch, pressure, force[CORNERS][DIM];
        EACH stretch[l] = 2.0 * psi_s(s[l], mu[l]);
        EACH pressure[l] = psi_J(J[l], mu[l], lambda[l]);
        for (int c = 0; c < SQUARE; c++) EACH P[c][l] = stretch[l] * F[c][l] + pressure[l] * C[c][l];
        for (int i = 0; i < DIM; i++) {
            EACH force[0][i][l] = 0.0;
            for (int a = 0; a < DIM; a++) {
                EACH force[a + 1][i][l] = 0.0;
                for (int j = 0; j < DIM; j++)
                    EACH force[a + 1][i][l] += P[i * DIM + j][l] * g[(a * DIM + j) * LANES + l];
                EACH force[0][i][l] -= force[a + 1][i][l];
            }
        }
        for (int a = 0; a < CORNERS; a++)
            EACH {
                double *at = gradient + (int64_t)corners[a * LANES + l] * DIM;
                for (int i = 0; i < DIM; i++) at[i] += force[a][i][l];
            }
    }
    *least = smallest;
    return energy;
}

/* The Hessian [N/m]: blocks on the diagonal (n_nodes, DIM, DIM) and above it (n_pairs, DIM, DIM), zeroed before. */
void hessian(const Cells *cells, const double *x, double *diagonal, double *upper) {
    for (int64_t group = 0; group < cells->groups; group++) {
        const int32_t *corners = cells->corners + group * CORNERS * LANES;
        const int32_t *pairs = cells->pairs + group * PAIRS * LANES;
        const double *g = cells->gradients + group * SQUARE * LANES;
        const double *mu = cells->mu + group * LANES, *lambda = cells->lambda + group * LANES;
        lanes F[SQUARE], C[SQUARE], s, J, G[CORNERS][DIM], Fg[CORNERS][DIM], Cg[CORNERS][DIM];
        kinematics(x, corners, g, F, C, s, J);
        for (int j = 0; j < DIM; j++) {
            EACH G[0][j][l] = 0.0;
            for (int a = 0; a < DIM; a++) {
                EACH G[a + 1][j][l] = g[(a * DIM + j) * LANES + l];
                EACH G[0][j][l] -= G[a + 1][j][l];
            }
        }
        for (int a = 0; a < CORNERS; a++)
            for (int i = 0; i < DIM; i++) {
                EACH Fg[a][i][l] = 0.0;
                EACH Cg[a][i][l] = 0.0;
                for (int j = 0; j < DIM; j++) {
                    EACH Fg[a][i][l] += F[i * DIM + j][l] * G[a][j][l];
                    EACH Cg[a][i][l] += C[i * DIM + j][l] * G[a][j][l];
                }
            }
        lanes by_s, by_ss, by_J, by_JJ;
        EACH by_s[l] = 2.0 * psi_s(s[l], mu[l]);
        EACH by_ss[l] = 4.0 * psi_ss(s[l], mu[l]);
        EACH by_J[l] = psi_J(J[l], mu[l], lambda[l]);
        EACH by_JJ[l] = psi_JJ(J[l], mu[l], lambda[l]);
        for (int a = 0, pair = 0; a < CORNERS; a++)
            for (int b = a; b < CORNERS; b++) {
                const lanes *ga = G[a], *gb = G[b];
                lanes K[SQUARE], isotropic;
                EACH isotropic[l] = 0.0;
                for (int j = 0; j < DIM; j++) EACH isotropic[l] += by_s[l] * ga[j][l] * gb[j][l];
                for (int i = 0; i < DIM; i++)
                    for (int k = 0; k < DIM; k++)
                        EACH K[i * DIM + k][l] = by_ss[l] * Fg[a][i][l] * Fg[b][k][l]
                                               + by_JJ[l] * Cg[a][i][l] * Cg[b][k][l] + (i == k) * isotropic[l];
                if (a < b) {
#if DIM == 3
                    lanes n[3], w;
                    for (int m = 0; m < 3; m++) {
                        int p = (m + 1) % 3, q = (m + 2) % 3;
                        EACH n[m][l] = ga[p][l] * gb[q][l] - ga[q][l] * gb[p][l];
                    }
                    for (int m = 0; m < 3; m++) {
                        int i = (m + 1) % 3, k = (m + 2) % 3; /* eps_ikm = 1 */
                        EACH w[l] = by_J[l] * (F[m * 3][l] * n[0][l] + F[m * 3 + 1][l] * n[1][l] + F[m * 3 + 2][l] * n[2][l]);
                        EACH K[i * 3 + k][l] += w[l];
                        EACH K[k * 3 + i][l] -= w[l];
                    }
#else
                    lanes n;
                    EACH n[l] = by_J[l] * (ga[0][l] * gb[1][l] - ga[1][l] * gb[0][l]);
                    EACH K[1][l] += n[l];
                    EACH K[2][l] -= n[l];
#endif
                }
                EACH {
                    double *at = a == b ? diagonal + (int64_t)corners[a * LANES + l] * SQUARE
                                        : upper + (int64_t)pairs[pair * LANES + l] * SQUARE;
                    for (int c = 0; c < SQUARE; c++) at[c] += K[c][l];
                }
                pair += a < b;
            }
    }
}
