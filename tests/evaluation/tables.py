"""Tables of results, for the terminal and for the report."""

from __future__ import annotations

import statistics

from tests.evaluation.results import Result


def values_of(results: list[Result], method: str) -> list[float]:
    """Joint SNR of every scene by a method, where there is one."""
    return [r.snr_db for r in results if r.method == method and r.snr_db is not None]


def summary_rows(results: dict[str, list[Result]]) -> list[list[str]]:
    """Header and one row per experiment and method: scenes, median and worst SNR."""
    rows = [["group", "method", "scenes", "median dB", "worst dB", "coefficients °"]]
    for name, of in results.items():
        for method in dict.fromkeys(result.method for result in of):
            values = values_of(of, method)
            errors = [r.error_deg for r in of if r.method == method and r.error_deg is not None]
            rows.append(
                [
                    name,
                    method,
                    str(len(values)),
                    f"{statistics.median(values):.1f}" if values else "",
                    f"{min(values):.1f}" if values else "",
                    f"{statistics.median(errors):.1f}" if errors else "",
                ]
            )
    return rows


def aligned(rows: list[list[str]]) -> str:
    """Text with columns under each other."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
