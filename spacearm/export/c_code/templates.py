"""The C files of an arm, in which $names stand for what the arm makes of them."""

from string import Template

HEADER = Template("""\
/* $arm.
 * The spacecraft is $mode. Written by spacearm; SI units, radians, spacecraft axes. */
#ifndef ${NAME}_H
#define ${NAME}_H

#define ${NAME}_JOINTS $N
#define ${NAME}_ROWS $K

#ifdef __cplusplus
extern "C" {
#endif
$declarations
/* J*, the motion of the tip per joint rate: $R rows [linear; angular] of $N, row by row. */
void ${name}_jacobian(const double q[$N]$p, double J[$R * $N]);

/* S, zero exactly where the task Jacobian is singular. */
double ${name}_singularity(const double q[$N]$p);

/* S, and its gradient by the joints. */
double ${name}_singularity_gradient(const double q[$N]$p, double gradient[$N]);

$more/* Bounds of the least singular value of the $K by $N task Jacobian. */
void ${name}_sigma_min(const double q[$N]$p, double *lower, double *upper);

#ifdef __cplusplus
}
#endif
#endif
""")

STRUCT = Template("""
/* Numbers of the arm, SI units: body 0 is the spacecraft, joint i (from 0) carries body i + 1. */
typedef struct {
$fields
} ${name}_parameters;

extern const ${name}_parameters ${name}_nominal; /* the arm's own */
""")

MORE = Template("""\
/* S, and its gradient by the parameters. */
double ${name}_singularity_by_parameters(const double q[$N], const ${name}_parameters *p,
                                         ${name}_parameters *gradient);

""")

NOMINAL = Template("""
const ${name}_parameters ${name}_nominal = {
$values
};
""")

SOURCE = Template("""\
#include "$name.h"

#include <math.h>
$constants
void ${name}_jacobian(const double q[$N]$p, double J[$R * $N])
{
$jacobian
}

double ${name}_singularity(const double q[$N]$p)
{
    double S;
$singularity
    return S;
}

double ${name}_singularity_gradient(const double q[$N]$p, double gradient[$N])
{
    double S;
$gradient
    return S;
}
""")

BY_PARAMETERS = Template("""
double ${name}_singularity_by_parameters(const double q[$N]$p, ${name}_parameters *gradient)
{
    double S;
$by_parameters
    return S;
}
""")

NEVER = Template("""
void ${name}_sigma_min(const double q[$N]$p, double *lower, double *upper)
{
    (void)q;$unused /* fewer joints than task rows: singular everywhere */
    *lower = 0.0;
    *upper = 0.0;
}
""")

REDUNDANT = Template("""
/* With T the task Jacobian and T^T = Q R (Householder), sigma_min of T is that of R. The largest
 * eigenvalue of B = R^-1 R^-T is b = sigma_min^-2, and b^p <= tr(B^p) <= $K b^p for every p.
 * B is squared $squarings times, scaled to trace 1 each time, so that p = 2^$squarings. */
void ${name}_sigma_min(const double q[$N]$p, double *lower, double *upper)
{
    static const int rows[$K] = {$rows};
    static const double scale[$K] = {$scale};
    double J[$R * $N], A[$N][$K], W[$K][$K], B[$K][$K], C[$K][$K];
    double trace[$squarings + 1], size = 0.0, margin, mean;
    int i, j, k, s;

    ${name}_jacobian(q$given, J);
    for (i = 0; i < $N; i++) {
        for (j = 0; j < $K; j++) {
            A[i][j] = scale[j] * J[rows[j] * $N + i];
            size += A[i][j] * A[i][j];
        }
    }
    size = sqrt(size);
    margin = $rounding * size;
    for (k = 0; k < $K; k++) { /* R, in the upper triangle of A */
        double norm = 0.0, share;
        for (i = k; i < $N; i++) {
            norm += A[i][k] * A[i][k];
        }
        norm = A[k][k] > 0.0 ? -sqrt(norm) : sqrt(norm);
        if (!(fabs(norm) > margin)) { /* sigma_min is at most what stands on the diagonal */
            *lower = 0.0;
            *upper = fabs(norm) + margin;
            return;
        }
        A[k][k] -= norm;
        for (j = k + 1; j < $K; j++) {
            share = 0.0;
            for (i = k; i < $N; i++) {
                share += A[i][k] * A[i][j];
            }
            share /= norm * A[k][k];
            for (i = k; i < $N; i++) {
                A[i][j] += share * A[i][k];
            }
        }
        A[k][k] = norm;
    }
    for (j = 0; j < $K; j++) { /* W = R^-1 */
        for (i = $K - 1; i >= 0; i--) {
            double rest = i == j ? 1.0 : 0.0;
            for (k = i + 1; k <= j; k++) {
                rest -= A[i][k] * W[k][j];
            }
            W[i][j] = i > j ? 0.0 : rest / A[i][i];
        }
    }
    trace[0] = 0.0;
    for (i = 0; i < $K; i++) {
        for (j = 0; j < $K; j++) {
            B[i][j] = 0.0;
            for (k = 0; k < $K; k++) {
                B[i][j] += W[i][k] * W[j][k];
            }
        }
        trace[0] += B[i][i];
    }
    for (s = 1; s <= $squarings; s++) {
        trace[s] = 0.0;
        for (i = 0; i < $K; i++) {
            for (j = 0; j < $K; j++) {
                C[i][j] = B[i][j] / trace[s - 1];
            }
        }
        for (i = 0; i < $K; i++) {
            for (j = 0; j < $K; j++) {
                B[i][j] = 0.0;
                for (k = 0; k < $K; k++) {
                    B[i][j] += C[i][k] * C[k][j];
                }
            }
            trace[s] += B[i][i];
        }
    }
    mean = trace[$squarings]; /* tr(B^p)^(1/p) */
    for (s = $squarings - 1; s >= 0; s--) {
        mean = trace[s] * sqrt(mean);
    }
    mean = 1.0 / sqrt(mean);
    *lower = mean > margin ? mean - margin : 0.0;
    *upper = mean * $spread + margin;
}
""")
