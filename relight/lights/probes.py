"""Measured lights whose numbers are in print: "probe:grace" and its like need no file.

Grace, Eucalyptus and St. Peter's: Ramamoorthi & Hanrahan 2001, figure 2 (Grace to the six digits of their prefilter.c,
in the units of the file). Kitchen and Galileo: the same table as the OpenGL Shading Language book continues it. Rows
are in the order of `ramamoorthi2001` (relight.sh.conventions), in its left-handed frame; columns red, green, blue.
Copies in circulation have slips (Grace L22 green -.5 for -.05; Eucalyptus L2-2 blue +.04, L2-1 green +.01).
"""

import numpy as np

from relight.files import UserError
from relight.sh.conventions import to_relight

GRACE = """ .078908  .043710  .054161   .039499  .034989  .060488  -.033974 -.018236 -.026940
           -.029213 -.005562  .000944  -.011141 -.005090 -.012231  -.026240 -.022401 -.047479
           -.015570 -.009471 -.014733   .056014  .021444  .013915   .021205 -.005432 -.030374"""
EUCALYPTUS = """ .38 .43 .45   .29 .36 .41   .04 .03 .01  -.10 -.10 -.09  -.06 -.06 -.04
                 .01 -.01 -.05  -.09 -.13 -.15  -.06 -.05 -.04   .02 .00 -.05"""
ST_PETERS = """ .36 .26 .23   .18 .14 .13  -.02 -.01 .00   .03 .02 .00   .02 .01 .00
               -.05 -.03 -.01  -.09 -.08 -.07   .01 .00 .00  -.08 -.03 .00"""
KITCHEN = """ .64 .67 .73   .28 .32 .33   .42 .60 .77  -.05 -.04 -.02  -.10 -.08 -.05
              .25 .39 .53   .38 .54 .71   .06 .01 -.02  -.03 -.02 -.03"""
GALILEO = """1.04 .76 .71   .44 .34 .34  -.22 -.18 -.17   .71 .54 .56   .64 .50 .52
             -.12 -.09 -.08  -.37 -.28 -.29  -.17 -.13 -.13   .55 .42 .42"""
PROBES = {"grace": GRACE, "eucalyptus": EUCALYPTUS, "stpeters": ST_PETERS, "kitchen": KITCHEN, "galileo": GALILEO}


def printed(name: str) -> np.ndarray:
    """The table (9, 3) as printed, in the convention `ramamoorthi2001`."""
    if name not in PROBES:
        raise UserError(f"probe:{name}: one of {', '.join(f'probe:{known}' for known in PROBES)}")
    return np.array(PROBES[name].split(), float).reshape(9, 3)


def probe(name: str) -> np.ndarray:
    """The light (9, 3) in relight's convention; scales differ, so bring it to a brightness before use."""
    return to_relight(printed(name), "ramamoorthi2001")
