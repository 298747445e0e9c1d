"""Words on pictures."""

from sucre_bench.imaging.drawing import font


def test_letters_of_european_languages_differ_from_each_other() -> None:
    """A letter that a font lacks is a box, as all others that it lacks."""
    drawn = {bytes(font(13).getmask(letter)) for letter in "äöüßéłž"}
    assert len(drawn) == 7
