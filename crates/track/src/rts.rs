//! The Rauch-Tung-Striebel smoother.

use nalgebra::{SMatrix, SVector};

/// One step of a Kalman filter over a recorded flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Epoch<const N: usize> {
    /// How the state came from the filtered state of the epoch before. Known inputs may be added to it.
    pub transition: SMatrix<f64, N, N>,
    /// Before the measurement.
    pub predicted_mean: SVector<f64, N>,
    pub predicted_covariance: SMatrix<f64, N, N>,
    /// After the measurement. The same where there was none.
    pub mean: SVector<f64, N>,
    pub covariance: SMatrix<f64, N, N>,
}

/// Added to the diagonal of a covariance before it is inverted: some states may be known exactly.
const REGULARISATION: f64 = 1e-12;

/// Means and covariances given all measurements, before and after each epoch.
///
/// H. E. Rauch, F. Tung, C. T. Striebel, "Maximum Likelihood Estimates of Linear Dynamic Systems", AIAA Journal 3(8) (1965):
/// `x_s = x_f + G (x_s' - x_p')` and `P_s = P_f + G (P_s' - P_p') G^T` with `G = P_f F^T P_p'^-1`, where a prime is the next
/// epoch. An epoch whose predicted covariance cannot be inverted breaks the chain: what is before it is smoothed by itself.
pub(crate) fn smooth<const N: usize>(
    epochs: &[Epoch<N>],
) -> Vec<(SVector<f64, N>, SMatrix<f64, N, N>)> {
    let mut smoothed: Vec<(SVector<f64, N>, SMatrix<f64, N, N>)> = epochs
        .iter()
        .map(|epoch| (epoch.mean, epoch.covariance))
        .collect();
    for at in (1..epochs.len()).rev() {
        let (here, next) = (&epochs[at - 1], &epochs[at]);
        let regular = next.predicted_covariance + SMatrix::identity() * REGULARISATION;
        let Some(factor) = regular.cholesky() else {
            continue;
        };
        // G^T = P_p^-1 F P_f.
        let gain = factor
            .solve(&(next.transition * here.covariance))
            .transpose();
        let (next_mean, next_covariance) = smoothed[at];
        let mean = here.mean + gain * (next_mean - next.predicted_mean);
        let covariance = here.covariance
            + gain * (next_covariance - next.predicted_covariance) * gain.transpose();
        smoothed[at - 1] = (mean, (covariance + covariance.transpose()) * 0.5);
    }
    smoothed
}

#[cfg(test)]
mod tests {
    use super::*;
    use adskalman::{
        KalmanFilterNoControl, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl,
    };
    use approx::assert_relative_eq;
    use nalgebra::{Matrix2, Matrix2x4, Matrix4, Matrix4x2, U2, U4, Vector2, Vector4};

    /// Constant velocity in the plane, the independent implementation's way.
    struct Motion {
        f: Matrix4<f64>,
        ft: Matrix4<f64>,
        q: Matrix4<f64>,
    }

    #[allow(non_snake_case)]
    impl TransitionModelLinearNoControl<f64, U4> for Motion {
        fn F(&self) -> &Matrix4<f64> {
            &self.f
        }
        fn FT(&self) -> &Matrix4<f64> {
            &self.ft
        }
        fn Q(&self) -> &Matrix4<f64> {
            &self.q
        }
    }

    struct Position {
        h: Matrix2x4<f64>,
        ht: Matrix4x2<f64>,
        r: Matrix2<f64>,
    }

    #[allow(non_snake_case)]
    impl ObservationModel<f64, U4, U2> for Position {
        fn H(&self) -> &Matrix2x4<f64> {
            &self.h
        }
        fn HT(&self) -> &Matrix4x2<f64> {
            &self.ht
        }
        fn R(&self) -> &Matrix2<f64> {
            &self.r
        }
        fn predict_observation(&self, state: &Vector4<f64>) -> Vector2<f64> {
            self.h * state
        }
    }

    #[test]
    fn it_is_what_adskalman_computes() {
        let dt = 0.5;
        let f = Matrix4::new(
            1.0, 0.0, dt, 0.0, //
            0.0, 1.0, 0.0, dt, //
            0.0, 0.0, 1.0, 0.0, //
            0.0, 0.0, 0.0, 1.0,
        );
        let q = Matrix4::from_diagonal(&Vector4::new(0.02, 0.02, 0.5, 0.5));
        let h = Matrix2x4::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0);
        let r = Matrix2::new(2.0, 0.3, 0.3, 1.0);
        let motion = Motion {
            f,
            ft: f.transpose(),
            q,
        };
        let position = Position {
            h,
            ht: h.transpose(),
            r,
        };
        let oracle = KalmanFilterNoControl::new(&motion, &position);
        let start =
            StateAndCovariance::new(Vector4::new(0.0, 0.0, 1.0, 0.0), Matrix4::identity() * 9.0);
        // A curve with a deterministic ripple; every fifth measurement is missing.
        let measured: Vec<Vector2<f64>> = (0..40)
            .map(|i| {
                let t = f64::from(i) * dt;
                if i % 5 == 4 {
                    Vector2::new(f64::NAN, f64::NAN)
                } else {
                    Vector2::new(3.0 * t + (7.0 * t).sin(), 0.1 * t * t + (5.0 * t).cos())
                }
            })
            .collect();
        let expected = oracle.smooth(&start, &measured).unwrap();

        let (mut mean, mut covariance) = (*start.state(), *start.covariance());
        let epochs: Vec<Epoch<4>> = measured
            .iter()
            .map(|z| {
                let (predicted_mean, predicted_covariance) =
                    (f * mean, f * covariance * f.transpose() + q);
                (mean, covariance) = (predicted_mean, predicted_covariance);
                if z.iter().all(|value| value.is_finite()) {
                    let s = h * covariance * h.transpose() + r;
                    let gain = covariance * h.transpose() * s.try_inverse().unwrap();
                    mean += gain * (z - h * mean);
                    covariance -= gain * s * gain.transpose();
                }
                Epoch {
                    transition: f,
                    predicted_mean,
                    predicted_covariance,
                    mean,
                    covariance,
                }
            })
            .collect();
        for ((mean, covariance), oracle) in smooth(&epochs).iter().zip(&expected) {
            assert_relative_eq!(mean, oracle.state(), epsilon = 1e-8);
            assert_relative_eq!(covariance, oracle.covariance(), epsilon = 1e-8);
        }
    }
}
