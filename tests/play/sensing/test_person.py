"""A person's finger, kept, and what two of them say of a screen."""

import numpy as np
import pytest

import haptix
from haptix.play.sensing import ContactCurrent, EnrolledFinger, contact_change
from haptix.play.sensing.contact import FORCE, Averaged, parts

BODY_F = haptix.Screen().body_capacitance_f


@pytest.fixture(scope="module")
def contact():
    known = haptix.ContactModel(haptix.Finger.preset("semi-wet"), haptix.Screen())
    return ContactCurrent.of_model(known, 4000.0)


def person(contact, force_n, factor=1.0, spread=0.01, **fields):
    """The known finger at a force, whose contact alone has a capacitance times a factor."""
    random, rows = np.random.default_rng(int(1000 * force_n)), []
    for volts in np.linspace(60, 140, 20):
        latent = np.zeros((1, 6))
        latent[0, FORCE] = np.log(force_n / contact.population.force_n)
        found = complex(contact.capacitance_f(latent, volts)[0])
        alone = factor * np.exp(spread * random.normal()) / (1 / found - 1 / BODY_F)
        series = alone * BODY_F / (alone + BODY_F)
        rows.append((force_n, volts, series.real, series.imag))
    covariance = tuple(map(tuple, np.eye(6).tolist()))
    made = {"mean": (0.0,) * 6, "covariance": covariance, "slid": tuple(rows)}
    return EnrolledFinger(**made | fields)


@pytest.mark.parametrize("factor", [1 / 1.1, 1.0, 1.1])
def test_a_contact_that_changed_is_flagged_at_another_force(contact, factor):
    change = contact_change(person(contact, 0.4), person(contact, 0.5, factor), contact)
    # Twenty parts of 1 % on either side: 0.3 %, and three of these.
    assert change.log_ratio == pytest.approx(np.log(factor), abs=0.01)
    assert change.is_sure
    assert change.is_changed == (factor != 1.0)


def test_uneven_slides_cannot_tell(contact):
    before, after = person(contact, 0.4, spread=0.3), person(contact, 0.5, spread=0.3)
    assert "cannot tell" in contact_change(before, after, contact).verdict


def test_what_cannot_be_compared_is_refused(contact):
    good = person(contact, 0.4)
    with pytest.raises(haptix.InputError, match="screen: expected the same"):
        contact_change(good, person(contact, 0.4, screen="other"), contact)
    with pytest.raises(haptix.InputError, match="after: expected a second"):
        contact_change(good, person(contact, 0.4, slid=good.slid[:3]), contact)


def test_it_is_kept_in_a_file(contact, tmp_path):
    one = person(contact, 0.4)
    one.save(tmp_path / "me.json")
    assert EnrolledFinger.load(tmp_path / "me.json") == one
    with pytest.raises(haptix.InputError, match="mean"):
        EnrolledFinger(mean=(0.0,), covariance=one.covariance)


def test_slides_without_a_force_are_left_out():
    rows = [Averaged(t, f, 100.0, 20e-12 - 1e-12j) for t, f in ((0.1, 0.4), (0.3, float("nan")))]
    assert parts(rows) == ((0.4, 100.0, 20e-12, -1e-12),)


def test_a_person_who_was_enrolled_is_not_overwritten(haptix_cli, tmp_path):
    (tmp_path / "me.json").write_text("{}")
    done = haptix_cli("enroll", tmp_path / "me.json")
    assert done.code == 2 and "--overwrite" in done.err
    assert (tmp_path / "me.json").read_text() == "{}"


@pytest.mark.slow
def test_a_finger_is_enrolled_and_a_screen_is_checked_by_the_commands(haptix_cli, own_folder):
    haptix.Screen().save("screen.toml")
    haptix.Finger.preset("semi-wet").save("finger.toml")
    for file, slider in (("then.json", "semi-wet"), ("now.json", "semi-wet"), ("wet.json", "wet")):
        done = haptix_cli("enroll", file, "--slider", slider, "--screen", "screen.toml")
        assert done.code == 0, done.err
    check = ("calibrate", "check", "--profile", "screen.toml", "--before", "then.json", "--after")
    assert "as before" in haptix_cli(*check, "now.json").out
    changed = haptix_cli(*check, "wet.json")
    assert changed.code == 1 and "changed" in changed.out
