//! Batch normalisation by domain.

use crate::error::TrainError;
use crate::model::input::{Norms, Part};
use crate::model::parameters::Parameters;
use crate::ops::{Group, follow_moments, norm_relu};
use burn::tensor::Tensor;
use grimnet_net::{BATCH_NORM_EPSILON, Domain};
use std::sync::Arc;

/// The statistics that normalise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Statistics {
    /// Those of the batch, for each domain; the running statistics are updated.
    Batch,
    /// The running statistics, which the model file contains.
    Running,
}

/// Normalises by domain (DA-BN; paper, eq. 3) and applies ReLU. Returns the result and the updated running statistics, which
/// are empty with [`Statistics::Running`].
///
/// # Shapes
/// `x` and the result `[n, h, w, c]`, the pictures of `parts` in order.
///
/// # Errors
/// Returns an error if the network has no normalisation `name`.
pub(super) fn norm_relu_by_domain(
    parameters: &Parameters,
    name: &str,
    x: Tensor<4>,
    parts: &[Part],
    statistics: Statistics,
) -> Result<(Tensor<4>, Vec<(String, Tensor<1>)>), TrainError> {
    let [n, h, w, c] = x.dims();
    let of = |domain: Domain, part: &str| parameters.flat(&domain.norm_name(name, part));
    let both = |part: &str| -> Result<Tensor<2>, TrainError> {
        Ok(Tensor::stack(
            vec![of(Domain::Sat, part)?, of(Domain::Uav, part)?],
            0,
        ))
    };
    let (gamma, beta) = (both("weight")?, both("bias")?);
    let rows = x.reshape([n * h * w, c]);
    let index = |domain: Domain| usize::from(domain == Domain::Uav);
    if statistics == Statistics::Running {
        let (mean, variance) = (both("mean")?, both("var")?);
        let scale = gamma / variance.add_scalar(BATCH_NORM_EPSILON).sqrt();
        let shift = beta - mean * scale.clone();
        let (mut out, mut start) = (Vec::new(), 0);
        for part in parts {
            let count = part.pictures * h * w;
            let row = index(part.domain);
            let y = rows.clone().narrow(0, start, count) * scale.clone().narrow(0, row, 1)
                + shift.clone().narrow(0, row, 1);
            out.push(y.clamp_min(0.0));
            start += count;
        }
        let y = Tensor::cat(out, 0).reshape([n, h, w, c]);
        return Ok((y, Vec::new()));
    }
    let groups = parts
        .iter()
        .map(|part| Group {
            rows: part.pictures * h * w,
            domain: index(part.domain),
        })
        .collect();
    let (y, mean, variance) = norm_relu(rows, gamma, beta, &Arc::new(groups), BATCH_NORM_EPSILON);
    let mut running = Vec::new();
    for (g, part) in parts.iter().enumerate() {
        let name = |what: &str| part.domain.norm_name(name, what);
        let row = |found: &Tensor<2>| found.clone().narrow(0, g, 1).reshape([c]);
        let old =
            |what: &str| Ok::<_, TrainError>(parameters.flat(&name(what))?.without_autodiff());
        let followed = follow_moments(
            [old("mean")?, old("var")?],
            [row(&mean), row(&variance)],
            part.pictures * h * w,
        );
        for (what, value) in ["mean", "var"].into_iter().zip(followed) {
            running.push((name(what), value));
        }
    }
    Ok((y.reshape([n, h, w, c]), running))
}

/// With one normalisation for both domains, copies the statistics and parameters of the map domain, the only ones that are trained, to
/// the photo domain.
///
/// # Errors
/// Returns an error if values cannot be read from the device.
pub(crate) fn share_norms(parameters: &mut Parameters, norms: Norms) -> Result<(), TrainError> {
    if norms == Norms::ByDomain {
        return Ok(());
    }
    for name in parameters.names() {
        if let Some((layer, part)) = Domain::Sat.norm_of(&name) {
            let value = parameters.flat(&name)?;
            parameters.set(&Domain::Uav.norm_name(layer, part), value)?;
        }
    }
    Ok(())
}
