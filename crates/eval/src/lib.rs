//! Evaluation of localisation: data sets with known positions, the evaluation loop, metrics, calibration and reports.
//!
//! Data flow: [`datasets::DataSet`] reads a folder into a [`scene::Scene`], a map with photos and their truth;
//! [`evaluation::evaluate`] localises each photo and compares the answer with the truth; [`metrics::Summary`] and its neighbours
//! make figures of the comparisons; [`report`] shows them. [`elsewhere`] localises photos that are not on the map, which must get
//! no fix. [`tracks`] does the same for flights: rendered, simulated, and
//! real ones with hidden fixes. [`calibration`] fits the stated radius and confidence of a model to answers whose truth is known.

pub mod calibration;
pub mod datasets;
pub mod elsewhere;
pub mod elsewhere_summary;
pub mod evaluation;
pub mod metrics;
pub mod report;
pub mod retrieval;
pub mod scene;
pub mod tracks;
pub mod validation_flight;
