// The map by keys, while it has the focus: Shift and the arrows move it under a cross, plus and minus zoom, Enter proposes
// to drive to the cross. Plain arrows drive, as everywhere.

const STEP = 60; // pixels that the map moves
const ZOOM = 1.35;
const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** `propose` is called with [x, y] in the world. */
export function listenToKeys(map, propose) {
  map.canvas.addEventListener("keydown", (event) => {
    const move = event.shiftKey && MOVES[event.code];
    if (move) shift(map, move);
    else if (event.key === "+" || event.key === "=") map.zoom(ZOOM);
    else if (event.key === "-") map.zoom(1 / ZOOM);
    else if (event.key === "Enter") propose([...map.centre]);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
}

function shift(map, [right, up]) {
  map.follow(false);
  map.centre = [map.centre[0] + right * STEP * map.pixel, map.centre[1] + up * STEP * map.pixel];
  map.renew();
}
