"""Stage three: which candidate a pixel gets."""

from recon.optimisation.learned import LearnedOptimisation
from recon.optimisation.protocol import Optimisation
from recon.optimisation.semi_global import SemiGlobal
from recon.optimisation.winner_takes_all import WinnerTakesAll

__all__ = ["OPTIMISATIONS", "LearnedOptimisation", "Optimisation", "SemiGlobal", "WinnerTakesAll"]

OPTIMISATIONS: dict[str, type[Optimisation]] = {
    "winner_takes_all": WinnerTakesAll,
    "semi_global": SemiGlobal,
    "learned": LearnedOptimisation,
}
