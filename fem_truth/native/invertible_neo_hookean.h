/* psi = mu/2 s - mu l(J) + lambda/2 l(J)^2, with l the logarithm, continued below J_0 = 0.3 by its Taylor polynomial of
 * second order: l = log m + d - d^2/2, l' = (1 - d)/m, l'' = -1/m^2 (see runtime.elasticity.materials) */
#define J_0 0.3
static inline double m_of(double J) { return J > J_0 ? J : J_0; }
static inline double d_of(double J) { return J > J_0 ? 0.0 : (J - J_0) / J_0; }
static inline double l_of(double J) { double d = d_of(J); return log(m_of(J)) + d - 0.5 * d * d; }
static inline double psi(double s, double J, double mu, double lambda) {
    double l = l_of(J);
    return 0.5 * mu * s - mu * l + 0.5 * lambda * l * l;
}
static inline double psi_s(double s, double mu) { return 0.5 * mu; }
static inline double psi_ss(double s, double mu) { return 0.0; }
static inline double psi_J(double J, double mu, double lambda) {
    return (lambda * l_of(J) - mu) * (1.0 - d_of(J)) / m_of(J);
}
static inline double psi_JJ(double J, double mu, double lambda) {
    double m = m_of(J), slope = (1.0 - d_of(J)) / m;
    return lambda * slope * slope - (lambda * l_of(J) - mu) / (m * m);
}
