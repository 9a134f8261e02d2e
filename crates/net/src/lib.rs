//! The GRiM-Net network: description, model file, CPU inference.
