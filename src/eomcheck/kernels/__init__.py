"""Machine code in milliseconds: a tape becomes a program, the program LLVM's code.

The way of the data: `eomcheck.numbers.tape` -> `program` (a tape with its loops found again) ->
`emit` (LLVM, by `code`; what is more than an operation by `sincos`, `dense`, `band`) -> `machine`
(an address). Everything is made for one lane, a double, or for several lanes side by side, each a
state of its own; a lane's bits are those of a single run.
"""
