//! Options that name one of the experiments or sweeps, or `all`.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use grimnet_experiments::experiment::Experiment;
use grimnet_experiments::sweep::Sweep;
use grimnet_experiments::training::TrainedExperiment;

/// The name of all.
const ALL: &str = "all";

/// An experiment, with a given network or with networks that it trains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Requested {
    /// With the network of the run.
    Measured(Experiment),
    /// With networks that the run trains.
    Trained(TrainedExperiment),
}

impl Requested {
    /// Name of its table.
    pub fn id(self) -> &'static str {
        match self {
            Self::Measured(experiment) => experiment.id(),
            Self::Trained(experiment) => experiment.id(),
        }
    }
}

/// What one value of an option names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named<T>(pub Vec<T>);

/// A name, its help and what it stands for.
type Choice<T> = (&'static str, &'static str, T);

/// A parser of these names; [`ALL`] stands for those of them that `is_in_all`.
fn parser<T: Copy + Send + Sync + 'static>(
    choices: Vec<Choice<T>>,
    all_help: &'static str,
    is_in_all: fn(&T) -> bool,
) -> impl TypedValueParser<Value = Named<T>> {
    let values: Vec<PossibleValue> = choices
        .iter()
        .map(|&(name, help, _)| (name, help))
        .chain([(ALL, all_help)])
        .map(|(name, help)| PossibleValue::new(name).help(help))
        .collect();
    PossibleValuesParser::new(values).map(move |text| {
        let is_named = |(name, _, what): &&Choice<T>| match text.as_str() {
            ALL => is_in_all(what),
            text => *name == text,
        };
        Named(choices.iter().filter(is_named).map(|c| c.2).collect())
    })
}

/// The parser of `--experiment`.
pub fn experiments() -> impl TypedValueParser<Value = Named<Requested>> {
    let measured = Experiment::ALL.map(|e| (e.id(), e.help(), Requested::Measured(e)));
    let trained = TrainedExperiment::ALL.map(|e| (e.id(), e.help(), Requested::Trained(e)));
    parser(
        measured.into_iter().chain(trained).collect(),
        "All that train no network",
        |requested| matches!(requested, Requested::Measured(_)),
    )
}

/// The parser of `--sweep`.
pub fn sweeps() -> impl TypedValueParser<Value = Named<Sweep>> {
    let choices = Sweep::ALL.map(|sweep| (sweep.id(), sweep.title(), sweep));
    parser(choices.to_vec(), "All of these", |_| true)
}

/// What all values of an option name, in order.
pub fn flat<T: Copy>(named: &[Named<T>]) -> Vec<T> {
    named.iter().flat_map(|n| n.0.iter().copied()).collect()
}
