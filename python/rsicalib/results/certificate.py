"""A certificate as a person holds it: values, text, and the sheet that is filed."""

from __future__ import annotations

from rsicalib.arrays import Alike
from rsicalib.facts.certified import CertificateShape
from rsicalib.report.sheet import sheet
from rsicalib.report.words import number
from rsicalib.tabular import Told

EXIT_CODES: dict[str, int] = {"within": 0, "not within": 4, "undecided": 3}
"""What the command returns."""


class Certificate(Alike, Told, CertificateShape, eq=False, repr=False):
    """Whether the largest error of a calibrated mechanism is within a limit."""

    @property
    def exit_code(self) -> int:
        """What the command returns: 0 within, 4 not within, 3 undecided."""
        return EXIT_CODES[self.decision]

    def text(self) -> str:
        """The certificate for people."""
        whose = " · ".join(x for x in (self.mechanism, self.device, self.valid_from) if x)
        lines = [whose, self.decided, *(f"  {reason}" for reason in self.reasons)]
        rows = [(f"known: {one.source}", number(one.error)) for one in self.known]
        if self.uncertainty is not None:
            found = self.uncertainty
            whole = f"U, {100 * self.confidence:g} %, of the largest error of {found.places} places"
            rows = [(whole, number(found.expanded)), *rows, ("", "")]
            rows += [("u, where it is known least", number(found.u))]
            rows += [(f"  {one.words}", number(one.u)) for one in found.budget]
        if rows:
            width = max(len(words) for words, _ in rows)
            lines += ["", f"  {'':{width}}{f'[{self.unit}]':>12}"]
            lines += [f"  {words:{width}}{size:>12}".rstrip() for words, size in rows]
        if self.decides is not None:
            lines += ["", "Poses that may decide it:", f"  rsicalib {self.decides}"]
        return "\n".join(lines) + "\n"

    def report(self) -> str:
        """One sheet for a quality department: HTML that needs no network."""
        return sheet(self)

    def __repr__(self) -> str:
        return f"<Certificate of {self.mechanism!r}: {self.decision}, {self.limit:g} {self.unit}>"
