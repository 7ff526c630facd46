/* psi = mu/2 s - mu/2 log(1 + s/4) - 3/4 mu (J - 1) + lambda/2 (J - 1)^2 (Smith et al. 2018) */
static inline double psi(double s, double J, double mu, double lambda) {
    return mu * (0.5 * s - 0.5 * log(1.0 + 0.25 * s) - 0.75 * (J - 1.0)) + 0.5 * lambda * (J - 1.0) * (J - 1.0);
}
static inline double psi_s(double s, double mu) { return 0.5 * mu * (1.0 - 1.0 / (4.0 + s)); }
static inline double psi_ss(double s, double mu) { return 0.5 * mu / ((4.0 + s) * (4.0 + s)); }
static inline double psi_J(double J, double mu, double lambda) { return lambda * (J - 1.0) - 0.75 * mu; }
static inline double psi_JJ(double J, double mu, double lambda) { return lambda; }
