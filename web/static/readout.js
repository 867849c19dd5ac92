/** Commanded (as applied), estimated and true force on the hand per heading axis, in newton: numbers and legend in one. */

const rows = Object.fromEntries(
  [...document.querySelectorAll("#forces tr")].map((row) => [row.dataset.force, [...row.querySelectorAll("td")]]),
);

function write(cells, force) {
  cells.forEach((cell, axis) => {
    const value = force?.[axis];
    // Rounding first keeps a small negative force from reading "-0.0".
    const text = value === null || value === undefined ? "–" : (Math.round(value * 10) / 10 + 0).toFixed(1);
    if (cell.textContent !== text) cell.textContent = text;
  });
}

/** Show a state of the stream; null where there is nothing to show. */
export function showForces(state) {
  const applied = state?.applied_command;
  write(rows.commanded, applied?.force_n.map((force, axis) => (applied.mask[axis] ? force : null)));
  write(rows.estimated, state?.end_effector.force_estimated_n);
  write(rows.true, state?.end_effector.force_true_n);
}
