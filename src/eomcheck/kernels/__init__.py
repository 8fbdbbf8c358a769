"""Just-in-time compiled kernels: a tape becomes a program, the program LLVM IR, that an address.

The data flow: `eomcheck.numbers.tape` -> `program` (a tape whose loops are found again) -> `emit`
(LLVM IR, by `llvm_builder`; what is more than an operation by `sincos`, `dense`, `band`) -> `jit`
(an address) -> `kernel` (to be called). All of it takes milliseconds. Code is generated for one
state or for several side by side, one per SIMD lane; the bits of a lane are those of a single run.

Beside it, for the analysis of rounding errors: `perturbed_trace` (a function recorded once and
replayed with perturbed operations, or on a batch), `perturbed_solves` and `batched_solves`.
"""
