"""Results that show themselves: as a picture, as a table, in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError
from .document import Figure, Section
from .figures import draw_on
from .html import to_fragment

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

Array = np.ndarray


class Shown:
    """A value with a picture (`figure`), a table (`to_frame`) and sections for a notebook (`sections`).

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> train[0].to_frame().columns[:3].tolist()
    ['t', 'q1', 'q2']
    """

    __slots__ = ()

    def figure(self) -> Figure:
        """Its picture as plain data, which reports draw as well."""
        raise ConfigurationError(f"there is no picture of {type(self).__name__}.")

    def to_frame(self) -> pd.DataFrame:
        """Its numbers as a pandas DataFrame."""
        raise ConfigurationError(f"there is no table of {type(self).__name__}.")

    def sections(self) -> Sequence[Section]:
        """Texts and tables that a notebook shows; none: what it prints."""
        return ()

    def plot(self, ax: Axes | Sequence[Axes] | None = None) -> Any:
        """Draw its picture (needs matplotlib: the extra `report`).

        Parameters
        ----------
        ax : Axes or sequence of Axes, optional
            Where to draw: as many axes as there are panels, or one that takes them all in. Without, a new figure.

        Returns
        -------
        Axes or array of Axes
            One for each panel; the axes themselves where there is one panel.
        """
        return draw_on(self.figure(), ax)

    def _repr_html_(self) -> str:
        sections = self.sections()
        return to_fragment(sections) if sections else f"<pre>{escape(str(self))}</pre>"
