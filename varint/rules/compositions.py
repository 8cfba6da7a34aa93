"""Kick and drift weights of the explicit compositions, in 50-digit decimal arithmetic.

A composition is (order, kicks, drifts): kick, drift, kick, …, drift, kick. All are symmetric and
given by their first half; what symmetry and consistency fix is computed, not tabulated. Published
tables have 12 to 26 digits: the numbers here are theirs, polished to 42 digits by Gauss–Newton
steps of least norm on the order conditions.
"""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import partial
from itertools import pairwise

from varint.rules.polynomials import PRECISE

Composition = tuple[int, list[Decimal], list[Decimal]]
ONE = Decimal(1)


def _of_verlet(order: int, *half: str) -> Composition:
    """Störmer–Verlet steps of lengths γ_1 h, γ_2 h, …, γ_1 h, the middle one such that they sum
    to h.
    """
    with localcontext(PRECISE):
        first = [Decimal(gamma) for gamma in half]
        gammas = [*first, ONE - 2 * sum(first), *reversed(first)]
        ends = [Decimal(0), *gammas, Decimal(0)]
        kicks = [(a + b) / 2 for a, b in pairwise(ends)]  # neighbouring half kicks merge
        return order, kicks, gammas


def _roots_of_four(steps: int) -> Composition:
    """Order 4 from `steps` steps: (steps − 1) γ + γ_0 = 1 and (steps − 1) γ³ + γ_0³ = 0."""
    with localcontext(PRECISE):
        gamma = 1 / (steps - 1 - Decimal(steps - 1) ** (ONE / 3))
        return _of_verlet(4, *[str(gamma)] * (steps // 2))


def _nystrom(order: int, kicks: tuple[str, ...], drifts: tuple[str, ...]) -> Composition:
    """Free kicks and drifts of a Runge–Kutta–Nyström splitting; the middle ones make both sums
    1.
    """
    with localcontext(PRECISE):
        b, a = [Decimal(x) for x in kicks], [Decimal(x) for x in drifts]
        if len(a) < len(b):  # even number of drifts: the middle is a kick
            a.append(ONE / 2 - sum(a))
            return order, [*b, ONE - 2 * sum(b), *reversed(b)], [*a, *reversed(a)]
        b.append(ONE / 2 - sum(b))
        return order, [*b, *reversed(b)], [*a, ONE - 2 * sum(a), *reversed(a)]


COMPOSITIONS: dict[str, Callable[[], Composition]] = {
    "verlet": partial(_of_verlet, 2),
    # Yoshida, Phys. Lett. A 150 (1990) 262; Forest & Ruth, Physica D 43 (1990) 105
    "yoshida4": partial(_roots_of_four, 3),
    # Suzuki, Phys. Lett. A 146 (1990) 319
    "suzuki4": partial(_roots_of_four, 5),
    # Blanes & Moan, J. Comput. Appl. Math. 142 (2002) 313, Table 3, SRKN_6^b
    "blanes-moan4": partial(
        _nystrom,
        4,
        (
            "0.0829844064174050188383474789422501124947464",
            "0.396309801498368077094911528263686739396077",
            "-0.0390563049223484351708652907653792422876101",
        ),
        (
            "0.245298957184271162603932426001400880407155",
            "0.604872665711079974960892697643076245220969",
        ),
    ),
    # Yoshida 1990, Table 1, solution A
    "yoshida6": partial(
        _of_verlet,
        6,
        "0.784513610477557263819497633866349875776824",
        "0.235573213359358133684793182978534601686468",
        "-1.17767998417887100694641568096431573463927",
    ),
    # Kahan & Li, Math. Comp. 66 (1997) 1089, 9 steps; Hairer, Lubich & Wanner (V.3.11)
    "kahan-li6": partial(
        _of_verlet,
        6,
        "0.392161444007314139279250557422671403804934",
        "0.332599136789359438599748637500049646881587",
        "-0.706246172557639359809964819549256459395511",
        "0.0822135962935508002314904481020563311032939",
    ),
    # Blanes & Moan 2002, Table 3, SRKN_11^b
    "blanes-moan6": partial(
        _nystrom,
        6,
        (
            "0.0414649985182628432987781339147049367239362",
            "0.198128671918066541136726473181496960612535",
            "-0.0400061921041526868888283635359448393756942",
            "0.0752539843015803411278788785270427555417512",
            "-0.0115113874206877700624432015012891995525926",
        ),
        (
            "0.123229775946271151561086380333366752590525",
            "0.290553797799558270366414169327916183330210",
            "-0.127049212625416915662505053827485934473020",
            "-0.246331761062075404194973489104062862596011",
            "0.357208872795927752619860349619310462836889",
        ),
    ),
    # Yoshida 1990, Table 2, solution D
    "yoshida8": partial(
        _of_verlet,
        8,
        "0.914844246229791566748793489847509604518120",
        "0.253693336566211354146146020689942076097653",
        "-1.44485223686060515769473065753739035495591",
        "-0.158240635368050175204066776759754247755445",
        "1.93813913762252598657918648744364176095359",
        "-1.96061023297531080760763337639966364079243",
        "0.102799849391796440698115131601225862911016",
    ),
    # Suzuki & Umeno 1993; McLachlan, SIAM J. Sci. Comput. 16 (1995) 151: the best of 15 steps
    "suzuki-umeno8": partial(
        _of_verlet,
        8,
        "0.741670364350612953448227801783806315603537",
        "-0.409100825800031593997300095893563417309918",
        "0.190754710296238379953876256450371662735461",
        "-0.573862471116082266656387726635535742159509",
        "0.299064181303655923844463540688602988225823",
        "0.334624918245298183784957979882182288633692",
        "0.315293092396766596632056663811002430994081",
    ),
    # Kahan & Li 1997, 17 steps; Hairer, Lubich & Wanner (V.3.13)
    "kahan-li8": partial(
        _of_verlet,
        8,
        "0.130202483088890080878817632096700522357247",
        "0.561162981775108384561964407700150567266159",
        "-0.389474962644847286408078598235248388836068",
        "0.158841906555155600896210745707152481412148",
        "-0.395903894133237577336231539347938936026771",
        "0.184539640978315707091832541533375462818987",
        "0.258374387686322047293979109994939471813076",
        "0.295011723609310298870966240218228112976543",
    ),
    # Sofroniou & Spaletta, Optim. Methods Softw. 20 (2005) 597, 35 steps
    "sofroniou-spaletta10": partial(
        _of_verlet,
        10,
        "0.0787957225216864192639076793382896066655256",
        "0.313096103415108527764812471920256821461803",
        "0.0279183832350780661095202732659494475087115",
        "-0.229592841593907094151213396801122704836931",
        "0.130962061077164863174656859292158363549448",
        "-0.269733405654510714344609732217286623648099",
        "0.0749733431558914356661371056390587135037589",
        "0.111993423999810204889575080737269905277267",
        "0.366133449546226751193148123537146946009022",
        "-0.399105630136035897878629810584015556896082",
        "0.103087398527471077315802769994503872284375",
        "0.411430873955890237820704118977477786897940",
        "-0.00486636058313526176219565930774240912472426",
        "-0.392033353708639906448081936429980141629719",
        "0.0519425029624496470371829048314042431472608",
        "0.0506650907599244963358743425096948739410407",
        "0.0496743706397298790545688006666647946018763",
    ),
}
