/* Products with a symmetric matrix of DIM x DIM blocks, stored as its diagonal and upper triangle, and the vector
 * operations of projected conjugate gradients, each in one pass over memory.
 *
 * A node vector has WIDTH numbers per node (in 3D the fourth is padding), so that a node fits one small vector register.
 * Blocks are stored row by row without padding. Above the diagonal a row is loaded as one register: the load may read
 * into the next block (the caller allocates one more at the end), and these values are multiplied by the padding of the
 * vector, which is always zero.
 *
 * Compiled with -DDIM=2 or 3 and -DREAL=float or double and -DTILE=... for each use; see library.py.
 */
#include <stdint.h>
#include <string.h>

#define WIDTH (DIM == 3 ? 4 : 2)
#define SQUARE (DIM * DIM)
#define CHUNK 512 /* nodes whose terms are summed in `real` before they are added to the sum in double */

typedef REAL real;
typedef real node __attribute__((vector_size(WIDTH * sizeof(REAL))));

static inline node load(const real *from) {
    node value;
    memcpy(&value, from, sizeof(node));
    return value;
}

static inline void store(real *to, node value) { memcpy(to, &value, sizeof(node)); }

static inline node clean(node value) {
#if DIM == 3
    value[3] = 0;
#endif
    return value;
}

static inline real sum(node value) {
#if DIM == 3
    return value[0] + value[1] + value[2];
#else
    return value[0] + value[1];
#endif
}

/* B v for the block B of a node */
static inline node times(const real *block, node v) {
    node result = {0};
    for (int i = 0; i < DIM; i++)
        for (int k = 0; k < DIM; k++) result[i] += block[i * DIM + k] * v[k];
    return result;
}

/* y = A x; returns x . y. starts (n + 1), columns (starts[n],): the blocks above the diagonal, row by row. */
double product(int64_t n, const int32_t *starts, const int32_t *columns, const real *diagonal, const real *upper,
               const real *x, real *y) {
    double energy = 0.0;
    memset(y, 0, n * sizeof(node));
    for (int64_t i = 0; i < n; i++) {
        const node xi = load(x + i * WIDTH);
        node row[DIM] = {{0}};
        for (int32_t at = starts[i]; at < starts[i + 1]; at++) {
            const int64_t j = columns[at];
            const node xj = load(x + j * WIDTH);
            node yj = load(y + j * WIDTH);
            const real *block = upper + (int64_t)at * SQUARE;
            for (int r = 0; r < DIM; r++) {
                const node values = load(block + r * DIM);
                row[r] += values * xj;
                yj += values * xi[r];
            }
            store(y + j * WIDTH, yj);
        }
        /* Rows above have already added their terms to y_i; rows below add none. */
        node yi = clean(load(y + i * WIDTH)) + times(diagonal + i * SQUARE, xi);
        for (int r = 0; r < DIM; r++) yi[r] += sum(row[r]);
        store(y + i * WIDTH, yi);
        energy += (double)sum(xi * yi);
    }
    return energy;
}

/* c = Q^T v, (tiles * TILE, WIDTH) in double. Q is stored in tiles of TILE columns: (tiles, n, TILE). */
void coordinates(int64_t n, int64_t tiles, const real *Q, const real *v, double *c) {
    memset(c, 0, tiles * TILE * WIDTH * sizeof(double));
    for (int64_t tile = 0; tile < tiles; tile++)
        for (int64_t begin = 0; begin < n; begin += CHUNK) {
            const int64_t end = begin + CHUNK < n ? begin + CHUNK : n;
            node sums[TILE] = {{0}};
            for (int64_t i = begin; i < end; i++) {
                const node vi = load(v + i * WIDTH);
                const real *q = Q + (tile * n + i) * TILE;
                for (int k = 0; k < TILE; k++) sums[k] += q[k] * vi;
            }
            for (int k = 0; k < TILE; k++)
                for (int d = 0; d < WIDTH; d++) c[(tile * TILE + k) * WIDTH + d] += (double)sums[k][d];
        }
}

/* (Q c)_i; four independent sums hide the latency of additions */
static inline node lifted(int64_t n, int64_t tiles, const real *Q, const real *c, int64_t i) {
    node part[4] = {{0}};
    for (int64_t tile = 0; tile < tiles; tile++) {
        const real *q = Q + (tile * n + i) * TILE, *at = c + tile * TILE * WIDTH;
        for (int k = 0; k < TILE; k++) part[k % 4] += q[k] * load(at + k * WIDTH);
    }
    return (part[0] + part[1]) + (part[2] + part[3]);
}

/* r -= alpha (y - Q c) and z = D^-1 r, both where `free` (n, WIDTH) is 1; returns |r|^2. inverse: (n, DIM, DIM). */
double descend(int64_t n, int64_t tiles, const real *Q, const real *c, const real *free, const real *inverse,
               double alpha, const real *y, real *r, real *z) {
    double square = 0.0;
    for (int64_t i = 0; i < n; i++) {
        const node moves = load(free + i * WIDTH);
        const node change = (real)alpha * (load(y + i * WIDTH) - lifted(n, tiles, Q, c, i));
        const node ri = load(r + i * WIDTH) - moves * change;
        store(r + i * WIDTH, ri);
        store(z + i * WIDTH, moves * times(inverse + i * SQUARE, ri));
        square += (double)sum(ri * ri);
    }
    return square;
}

/* z -= Q c; returns r . z */
double deflate(int64_t n, int64_t tiles, const real *Q, const real *c, const real *r, real *z) {
    double rho = 0.0;
    for (int64_t i = 0; i < n; i++) {
        const node zi = load(z + i * WIDTH) - lifted(n, tiles, Q, c, i);
        store(z + i * WIDTH, zi);
        rho += (double)sum(load(r + i * WIDTH) * zi);
    }
    return rho;
}

/* inverse = B^-1 of the symmetric blocks (n, DIM, DIM). Blocks that are not positive definite (Sylvester) are left to the caller: their indices are written to `left`, their count is returned. */
int64_t invert(int64_t n, const double *blocks, real *inverse, int64_t *left) {
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++) {
        const double *b = blocks + i * SQUARE;
        double cofactor[SQUARE], trace = 0.0, scale = 1.0;
#if DIM == 3
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {
                const int p = (r + 1) % 3, q = (r + 2) % 3, s = (c + 1) % 3, t = (c + 2) % 3;
                cofactor[r * 3 + c] = b[p * 3 + s] * b[q * 3 + t] - b[p * 3 + t] * b[q * 3 + s];
            }
#else
        cofactor[0] = b[3], cofactor[1] = -b[2], cofactor[2] = -b[1], cofactor[3] = b[0];
#endif
        double det = 0.0;
        for (int c = 0; c < DIM; c++) det += b[c] * cofactor[c];
        for (int c = 0; c < DIM; c++) trace += b[c * (DIM + 1)];
        for (int c = 0; c < DIM; c++) scale *= trace / DIM;
        /* In 2D the last cofactor is the first entry itself. */
        const int positive = b[0] > 0.0 && cofactor[SQUARE - 1] > 0.0 && det > 1e-9 * scale;
        if (!positive) left[count++] = i;
        for (int c = 0; c < SQUARE; c++) inverse[i * SQUARE + c] = positive ? (real)(cofactor[c] / det) : 0;
    }
    return count;
}

/* x += alpha p, then p = z + beta p */
void advance(int64_t n, double alpha, double beta, const real *z, real *x, real *p) {
    for (int64_t i = 0; i < n * WIDTH; i++) {
        x[i] += (real)alpha * p[i];
        p[i] = z[i] + (real)beta * p[i];
    }
}
