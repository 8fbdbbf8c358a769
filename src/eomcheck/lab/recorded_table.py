"""Recorded tables: states and answers as named columns of a CSV, JSON, NPZ or Parquet file.

A column has a name such as `q[elbow]`, `M[0;1]` or `J[tool][x;elbow]`. Numbers of text files are
known to their printed digits only. A column is printed with a fixed number of decimals or with a
number of significant digits, and trailing zeros may be left out (`%g`): both are the largest that
occur in its first rows, and a number is known to half a unit of its last digit by either. Numbers
of NPZ and Parquet files are known to the unit roundoff of their type.

A header says how the numbers are meant: lines `# name: text` before the names of the columns of a
CSV, a text `header` of such lines in a JSON or NPZ, and in the metadata of a Parquet file.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice, takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.atomic_write import replacing, write_text
from eomcheck.errors import InputError, described_error, did_you_mean, required
from eomcheck.numbers.generic import Array

FORMATS = (".csv", ".json", ".npz", ".parquet")
"""Suffixes of files with recorded tables."""

CHUNK = 4096
"""Number of rows that are read at once."""

MEASURED_ROWS = 1000
"""Number of rows from which the printed digits of a column are taken."""

EXACT_DIGITS = 17
"""Number of significant digits that tell a float64 number from all others."""

NUMBER = re.compile(r"\s*[-+]?(\d*)(?:\.(\d*))?(?:[eE]([-+]?\d+))?\s*$")


class Digits(NamedTuple):
    """Printed digits of a column.

    Attributes:
        decimals: number of digits behind the point, negative for powers of ten.
        significant: number of significant digits.
        roundoff: unit roundoff of binary numbers with fewer digits than float64; 0 of others.
    """

    decimals: int
    significant: int
    roundoff: float = 0.0

    def error_of(self, x: Array) -> Array:
        """Return the largest rounding error of printed numbers x, same shape."""
        if self.roundoff:
            return self.roundoff * np.abs(x)
        if self.significant >= EXACT_DIGITS:
            return np.zeros(x.shape)
        with np.errstate(divide="ignore", over="ignore"):  # of 0; of a column without a number
            exponent = np.floor(np.log10(np.abs(x)))
            last = np.where(np.isfinite(exponent), exponent - self.significant + 1, -np.inf)
            return 0.5 * 10.0 ** np.maximum(last, -self.decimals)

    @property
    def text(self) -> str:
        """Description for people."""
        if self.roundoff:
            return f"binary digits to {self.roundoff:.2g}"
        if self.significant >= EXACT_DIGITS:
            return "all digits"
        return f"{self.significant} digits, {max(0, self.decimals)} decimals"


def most_digits(columns: Iterable[Digits]) -> Digits:
    """Return the most digits of any of the columns that are printed in one format."""
    decimals, significant, roundoff = zip(*columns, strict=True)
    return Digits(max(decimals), max(significant), max(roundoff))


EXACT = Digits(EXACT_DIGITS, EXACT_DIGITS)
"""Digits of a column that holds float64 numbers."""


def digits_of_type(kind: Any) -> Digits:
    """Return the digits of a column of a numpy type, such as float32."""
    dtype = np.dtype(kind)
    if dtype.kind != "f" or dtype.itemsize >= np.dtype(np.float64).itemsize:
        return EXACT
    return EXACT._replace(roundoff=float(np.finfo(dtype).eps) / 2)


def digits_of(texts: Iterable[str]) -> Digits:
    """Return the printed digits of a column from the texts of its numbers."""
    decimals, significant = -400, 1
    for text in texts:
        match = NUMBER.match(text)
        if match is None:
            continue
        whole, fraction, exponent = match[1] or "", match[2] or "", int(match[3] or 0)
        decimals = max(decimals, len(fraction) - exponent)
        significant = max(significant, len((whole + fraction).lstrip("0")))
    return Digits(decimals, significant)


class Chunk(NamedTuple):
    """Rows of a table.

    Attributes:
        first: index of its first row.
        values: array (rows, columns).
    """

    first: int
    values: Array


class RecordedTable(NamedTuple):
    """A table in a file, which is read in chunks of rows.

    Attributes:
        path: the file.
        names: names of the columns.
        digits: printed digits of each column.
        header: name -> text of the lines of its header.
        head: number of lines before the names of the columns of a CSV.
    """

    path: Path
    names: tuple[str, ...]
    digits: tuple[Digits, ...]
    header: Mapping[str, str] = {}
    head: int = 0

    def chunks(self) -> Iterator[Chunk]:
        """Yield all rows in chunks.

        Raises:
            InputError: a row has another number of columns, or an entry is no number.
        """
        if self.path.suffix == ".csv":
            yield from _csv_chunks(self.path, len(self.names))
            return
        if self.path.suffix == ".parquet":
            yield from _parquet_chunks(self.path, self.names)
            return
        columns, _ = _columns_in(self.path)
        arrays = [columns[name] for name in self.names]
        for first in range(0, len(arrays[0]), CHUNK):
            part = np.column_stack([x[first : first + CHUNK] for x in arrays])
            yield Chunk(first, part.astype(np.float64, copy=False))

    def line_of(self, row: int) -> str:
        """Return the place of a row: of a CSV its line, that of the first line is 1."""
        where = f" (line {row + 2 + self.head})" if self.path.suffix == ".csv" else ""
        return f"row {row}{where}"


def open_table(path: Path) -> RecordedTable:
    """Return the table in a file.

    Raises:
        InputError: it is not there, is of another format, has no rows, or its columns are no
            columns of numbers with names of their own.
        EngineError: a Parquet file, and pyarrow is not installed.
    """
    if path.suffix not in FORMATS:
        raise InputError(f"{str(path)!r}: expected a file {', '.join(FORMATS)}")
    if not path.is_file():
        raise InputError(f"{str(path)!r} is not a file")
    if path.suffix == ".csv":
        return _open_csv(path)
    if path.suffix == ".parquet":
        return _open_parquet(path)
    columns, header = _columns_in(path)
    lengths = {len(column) for column in columns.values()}
    if len(lengths) > 1:
        name, length = min(((name, len(x)) for name, x in columns.items()), key=lambda x: x[1])
        raise InputError(f"{str(path)!r}: column {name!r} has {length} rows, others more")
    if lengths <= {0}:
        raise InputError(f"{str(path)!r} has no rows")
    digits = tuple(digits_of_type(x.dtype) for x in columns.values())
    return RecordedTable(path, tuple(columns), digits, header)


HEADER = "header"
"""Name of the text with the header of a JSON, NPZ or Parquet file."""


def parse_header(lines: Iterable[str]) -> dict[str, str]:
    """Return name -> text of the lines `# name: text` among some lines."""
    matches = (re.match(r"\s*#?\s*(\w+)\s*:\s*(.*\S)\s*$", line) for line in lines)
    return {match[1].lower(): match[2] for match in matches if match}


# ---- CSV -----------------------------------------------------------------------------------------


def _rows_of(path: Path) -> Iterator[list[str]]:
    """Yield the rows of a CSV file, without empty lines and comments (#)."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = (line for line in file if not line.startswith("#"))
            for row in csv.reader(lines, skipinitialspace=True):
                if row:
                    yield row
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{str(path)!r} cannot be read: {described_error(error)}") from error


def _head_of(path: Path) -> list[str]:
    """Return the comments and empty lines with which a CSV file begins."""
    with path.open(encoding="utf-8-sig") as file:
        return list(takewhile(lambda line: line.startswith("#") or not line.strip(), file))


def _open_csv(path: Path) -> RecordedTable:
    rows = _rows_of(path)
    names = tuple(name.strip() for name in next(rows, []))
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{str(path)!r} has two columns {twice[0]!r}")
    if not any(NAME.match(name) for name in names):
        raise InputError(f"{str(path)!r} has no names of columns in its first line")
    first = [row for row in islice(rows, MEASURED_ROWS) if len(row) == len(names)]
    if not first:
        raise InputError(f"{str(path)!r} has no rows")
    columns = zip(*first, strict=True)
    head = _head_of(path)
    digits = tuple(digits_of(column) for column in columns)
    return RecordedTable(path, names, digits, parse_header(head), len(head))


def _csv_chunks(path: Path, width: int) -> Iterator[Chunk]:
    rows, first, head = _rows_of(path), 0, len(_head_of(path))
    names = next(rows)
    while block := list(islice(rows, CHUNK)):
        try:
            values = np.array(block, np.float64)
        except ValueError:
            values = _checked_numbers(path, names, block, first, head)
        if values.shape[1:] != (width,):
            raise InputError(f"{str(path)!r}, row {first}: {len(block[0])} columns, not {width}")
        yield Chunk(first, values)
        first += len(block)


def _checked_numbers(
    path: Path, names: Sequence[str], block: list[list[str]], first: int, head: int
) -> Array:
    """Return the numbers of rows, empty entries as NaN; raise InputError about the first wrong."""
    values = np.empty((len(block), len(names)))
    for k, row in enumerate(block):
        where = f"{str(path)!r}, row {first + k} (line {first + k + 2 + head})"
        if len(row) != len(names):
            raise InputError(f"{where}: {len(row)} columns, expected {len(names)}")
        for j, text in enumerate(row):
            try:
                values[k, j] = float(text) if text.strip() else np.nan
            except ValueError:
                raise InputError(f"{where}: {names[j]} = {text!r} is no number") from None
    return values


# ---- Other formats -------------------------------------------------------------------------------


def _columns_in(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    """Return the columns of a JSON or NPZ file, and its header."""
    readers = {".json": _json_columns, ".npz": _npz_columns}
    try:
        columns = {str(name): x for name, x in readers[path.suffix](path).items()}
        header = parse_header(str(np.asarray(columns.pop(HEADER, ""))).splitlines())
        arrays = {name: _numbers(x) for name, x in columns.items()}
    except (OSError, ValueError, TypeError, AttributeError, KeyError) as error:
        raise InputError(f"{str(path)!r} cannot be read: {described_error(error)}") from error
    for name, array in arrays.items():
        if array.ndim != 1:
            raise InputError(f"{str(path)!r}: {name} has shape {array.shape}, expected one column")
    return arrays, header


def _numbers(x: Any) -> Array:
    """Return a column as numbers: those of an array with floating point in their type."""
    array = np.asarray(x)
    return array if array.dtype.kind == "f" else array.astype(np.float64)


def _json_columns(path: Path) -> Mapping[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def _npz_columns(path: Path) -> Mapping[str, Any]:
    with np.load(path, allow_pickle=False) as file:
        return dict(file)


def _parquet_file(path: Path) -> Any:
    try:
        return required("pyarrow.parquet", "pyarrow").ParquetFile(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{str(path)!r} cannot be read: {described_error(error)}") from error


def _open_parquet(path: Path) -> RecordedTable:
    file = _parquet_file(path)
    schema = file.schema_arrow
    if not file.metadata.num_rows:
        raise InputError(f"{str(path)!r} has no rows")
    kinds = {field.name: field.type for field in schema}
    try:
        digits = tuple(digits_of_type(kind.to_pandas_dtype()) for kind in kinds.values())
    except (TypeError, NotImplementedError) as error:
        raise InputError(f"{str(path)!r} has a column of no numbers") from error
    text = (schema.metadata or {}).get(HEADER.encode(), b"").decode()
    return RecordedTable(path, tuple(kinds), digits, parse_header(text.splitlines()))


def _parquet_chunks(path: Path, names: Sequence[str]) -> Iterator[Chunk]:
    first = 0
    for batch in _parquet_file(path).iter_batches(CHUNK):
        columns = [batch.column(name).to_numpy(zero_copy_only=False) for name in names]
        try:
            values = np.column_stack(columns).astype(np.float64, copy=False)
        except (TypeError, ValueError) as error:
            raise InputError(f"{str(path)!r} has a column of no numbers") from error
        yield Chunk(first, values)
        first += len(values)


def write_table(
    path: Path, columns: Mapping[str, Array], header: Mapping[str, str] | None = None
) -> None:
    """Write columns of numbers, in text with all digits.

    Args:
        path: the file.
        columns: name of a column -> its numbers.
        header: name -> text of the lines of a header.

    Raises:
        InputError: the file has another suffix than `FORMATS`, or cannot be written.
        EngineError: a Parquet file, and pyarrow is not installed.
    """
    lines = [f"# {name}: {text}" for name, text in (header or {}).items()]
    text = {HEADER: "\n".join(lines)} if lines else {}
    match path.suffix:
        case ".csv":
            rows = zip(*(column.tolist() for column in columns.values()), strict=True)
            lines += [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
            write_text(path, "\n".join(lines) + "\n")
        case ".json":
            document = text | {name: x.tolist() for name, x in columns.items()}
            write_text(path, json.dumps(document) + "\n")
        case ".npz":
            with replacing(path) as temporary, temporary.open("wb") as file:
                np.savez(file, allow_pickle=False, **text, **dict(columns))
        case ".parquet":
            arrow = required("pyarrow", "pyarrow")
            table = arrow.table(dict(columns)).replace_schema_metadata(text)
            with replacing(path) as temporary:
                required("pyarrow.parquet", "pyarrow").write_table(table, temporary)
        case _:
            raise InputError(f"{str(path)!r}: expected a file {', '.join(FORMATS)}")


# ---- Names of columns ----------------------------------------------------------------------------

NAME = re.compile(r"((?:base\.)?[A-Za-z_]\w*)((?:\[[^\[\]]*\])*)$")


class ColumnName(NamedTuple):
    """Parts of the name of a column: `J[tool][x;elbow]` is ("J", ("tool", "x;elbow")).

    Attributes:
        quantity: name before the brackets.
        brackets: texts in the brackets.
    """

    quantity: str
    brackets: tuple[str, ...]


def parse_name(name: str) -> ColumnName | None:
    """Return the parts of the name of a column, None for what is no such name."""
    match = NAME.match(name.strip())
    if match is None:
        return None
    return ColumnName(match[1], tuple(re.findall(r"\[([^\[\]]*)\]", match[2])))


def index_in(text: str, names: Sequence[tuple[str, ...]], column: str) -> tuple[int, ...]:
    """Return the index of an entry from the text in brackets, names or numbers from 0 on.

    Args:
        text: such as "elbow", "0;1" or "x;elbow"; commas separate too.
        names: names along each axis of the array.
        column: name of the column, for messages.

    Raises:
        InputError: another number of indices, or no such name.
    """
    parts = [part.strip() for part in re.split("[;,]", text)] if text else []
    if len(parts) != len(names):
        raise InputError(f"column {column!r}: expected {len(names)} indices, not {len(parts)}")
    index = []
    for part, along in zip(parts, names, strict=True):
        known = {name: k for k, name in enumerate(along)}
        known |= {name.replace("ω", "w"): k for name, k in known.items()}
        if part in known:
            index.append(known[part])
        elif part.isdecimal() and int(part) < len(along):
            index.append(int(part))
        else:
            shown = ", ".join(along[:8]) + (", ..." if len(along) > 8 else "")
            hint = did_you_mean(part, known)
            raise InputError(f"column {column!r}: {part!r} is none of {shown}{hint}")
    return tuple(index)
