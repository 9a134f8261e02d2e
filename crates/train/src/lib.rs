//! Training the GRiM-Net network: modules, losses, data, loop, export.
