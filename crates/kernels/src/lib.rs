//! Convolution, pooling and matrix kernels for the grimnet network, chosen for the processor at run time.
