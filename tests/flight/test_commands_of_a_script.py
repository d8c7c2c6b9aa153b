"""Commands of a script to a vehicle with a companion: single actions, one after the other."""

from tests.flight.card import ONE_STYLE, Card

from gloc3_groundstation.desk.vehicle_commands import parse_vehicle_command


@ONE_STYLE
def test_a_vehicle_takes_off_goes_to_a_place_holds_and_lands_by_words(flight: Card) -> None:
    flight.begin("hop", platform="pelican_rtk", is_started=False)
    commands, name = flight.flight.ground.desk().commands, flight.flight.name
    shown = {}
    for text in ("take_off 2", "hold", "go_to 3 1 2", "return", "land"):
        command = parse_vehicle_command(text)
        shown[text] = flight.run(commands.carry_out(name, command, ready_s=60.0, within_s=60.0))
    assert shown["take_off 2"].startswith("armed, in air")
    assert "x 3.0  y 1.0  h 2.0 m" in shown["go_to 3 1 2"]
    assert shown["land"].startswith("disarmed, on ground")
