"""Just-in-time (JIT) compiled kernels: from a tape to a program, to LLVM IR, to machine code.

The data flow: `eomcheck.numbers.tape` -> `program` (a tape with its loops rerolled) -> `kernel`
(LLVM IR, and a callable; groups of operations by `sincos` and `linear_solves`), with `llvm`
(address of machine code). All of it takes milliseconds. Code is generated for a single
state or for a batch of states, one per SIMD lane; each lane has the bits of a single run.

For perturbation analysis: `perturbed_trace` (a function is recorded once and replayed with
perturbed operations, or on a batch), `perturbed_solves` and `batched_solves`.
"""
