//! Paper mode: the procedure of GRiM-Net (Remote Sens. 2026, 18(10), 1477) without additions.

pub mod equations;
pub mod options;
pub mod procedure;
