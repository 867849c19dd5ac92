"""A tick's row holds what the session holds, though only what is new is written."""

from dataclasses import replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.tick_layout import TICK
from sim.runtime.tick_row import TickRow


def test_a_row_written_tick_by_tick_is_one_written_afresh() -> None:
    session = Simulation(SimulationConfig(seed=4))
    pressing = replace(DEFAULT_COMMAND, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 8.0]))
    row = TickRow()
    for tick in range(400):
        if tick == 150:
            session.select_estimator("gmo_cqp")
        session.tick(DEFAULT_COMMAND if tick < 80 else pressing if tick < 300 else replace(pressing, guidance=True))
        if tick == 350:
            session.reset(seed=5)
            session.tick(DEFAULT_COMMAND)
        assert bytes(row.write(session)) == bytes(TickRow().write(session))


def test_a_row_holds_the_sessions_values() -> None:
    session = Simulation(SimulationConfig(seed=4))
    command = replace(DEFAULT_COMMAND, mask=np.array([0.0, 1.0, 0.0]))
    row = TickRow()
    for _ in range(30):
        session.tick(command, 0.25)
        row.write(session)
    written = np.frombuffer(row.write(session), TICK)[0]
    output, names = session.output, session.pipeline.estimator_names
    chosen = output.estimates[session.pipeline.estimator_name]
    assert written["time_s"] == session.time_s
    assert written["command_age_s"] == 0.25
    np.testing.assert_array_equal(written["joint_torque"], session.sensor.joint_torque)
    np.testing.assert_array_equal(written["applied_mask"], output.applied_command.mask)
    np.testing.assert_array_equal(written["target_position"], output.joint_command.position)
    np.testing.assert_array_equal(written["sigma_n"], chosen.sigma_n)
    for name, force in zip(names, written["estimates_n"], strict=False):
        np.testing.assert_array_equal(force, output.estimates[name].force_estimated_n)
    assert np.isnan(written["estimates_n"][len(names) :]).all()
