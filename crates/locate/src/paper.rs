//! Paper mode: the procedure of GRiM-Net (Remote Sens. 2026, 18(10), 1477). The table "The paper and this program" of EVALUATION.md
//! says what is as published and what differs.

pub mod equations;
pub mod options;
pub mod procedure;
