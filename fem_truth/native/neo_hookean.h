/* psi = mu/2 s - mu log J + lambda/2 (log J)^2; not a number where J <= 0 (Bonet and Wood 1997) */
static inline double psi(double s, double J, double mu, double lambda) {
    double log_J = log(J);
    return 0.5 * mu * s - mu * log_J + 0.5 * lambda * log_J * log_J;
}
static inline double psi_s(double s, double mu) { return 0.5 * mu; }
static inline double psi_ss(double s, double mu) { return 0.0; }
static inline double psi_J(double J, double mu, double lambda) { return (lambda * log(J) - mu) / J; }
static inline double psi_JJ(double J, double mu, double lambda) { return (mu + lambda * (1.0 - log(J))) / (J * J); }
