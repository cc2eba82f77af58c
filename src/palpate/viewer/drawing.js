// A body and what lies on it, on a canvas: turned by dragging or by arrow keys, nearer with + and -, as it was with 0.
// What a pointer rests on says more. Facets are drawn from the furthest to the nearest.
((box) => {
  const data = JSON.parse(box.querySelector("script[type='application/json']").textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const canvas = box.querySelector("canvas"), tip = box.querySelector("output"), pen = canvas.getContext("2d");
  const points = Float32Array.from(new Uint16Array(bytes(data.vertices)), (v) => v / 65535 - 0.5);
  const faces = new Uint32Array(bytes(data.faces)), count = faces.length / 3;
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]], dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const l = Math.hypot(...a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };
  const at = (k) => [points[3 * k], points[3 * k + 1], points[3 * k + 2]];
  const normals = [], middles = [];
  for (let f = 0; f < count; f++) {
    const [a, b, c] = [at(faces[3 * f]), at(faces[3 * f + 1]), at(faces[3 * f + 2])];
    normals.push(unit(cross(sub(b, a), sub(c, a))));
    middles.push([(a[0] + b[0] + c[0]) / 3, (a[1] + b[1] + c[1]) / 3, (a[2] + b[2] + c[2]) / 3]);
  }
  const outer = [...data.marks.flatMap((mark) => [mark.point, mark.force ? sub(mark.point, mark.force) : mark.point])];
  for (let k = 0; k < points.length / 3; k++) outer.push(at(k));
  const first = { turn: Math.atan2(data.look[1], data.look[0]), rise: Math.asin(unit(data.look)[2]), near: 1 };
  let view = { ...first }, placed = [], asked = false;
  const theme = () => getComputedStyle(box).color;
  function draw() {
    asked = false;
    const wide = canvas.clientWidth, high = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
    if (!wide) return;
    if (canvas.width !== Math.round(wide * ratio)) { canvas.width = wide * ratio; canvas.height = high * ratio; }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, wide, high);
    const [ct, st, cr, sr] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.rise), Math.sin(view.rise)];
    const eye = [cr * ct, cr * st, sr], right = [-st, ct, 0], up = [-sr * ct, -sr * st, cr];
    const reach = (way) => outer.reduce((most, p) => Math.max(most, Math.abs(dot(p, way))), 1e-9);
    const scale = 0.44 * view.near * Math.min(wide / reach(right), high / reach(up));  // it fills its picture
    const pixel = (p) => [wide / 2 + scale * dot(p, right), high / 2 - scale * dot(p, up)];
    const order = [];
    for (let f = 0; f < count; f++) if (data.open || dot(normals[f], eye) > 0) order.push([dot(middles[f], eye), f]);
    order.sort((a, b) => a[0] - b[0]);
    const light = unit([eye[0] + 0.4 * up[0] - 0.3 * right[0], eye[1] + 0.4 * up[1] - 0.3 * right[1], eye[2] + 0.4 * up[2]]);
    for (const [, f] of order) {
      const shade = Math.round(120 + 105 * Math.abs(dot(normals[f], light)));
      pen.fillStyle = pen.strokeStyle = `rgb(${shade - 8},${shade - 3},${shade + 3})`;
      pen.lineWidth = 0.6;
      pen.beginPath();
      for (let k = 0; k < 3; k++) pen.lineTo(...pixel(at(faces[3 * f + k])));
      pen.closePath();
      pen.fill();
      pen.stroke();
    }
    const seen = (mark) => dot(mark.normal, eye) > -0.05;
    for (const speck of data.specks) {
      if (dot(speck.slice(3, 6), eye) < 0) continue;
      pen.fillStyle = `rgb(${speck.slice(6)})`;
      pen.beginPath(); pen.arc(...pixel(speck), 1.7, 0, 7); pen.fill();
    }
    placed = [];
    const marks = data.marks.map((mark) => [dot(mark.point, eye), mark]).sort((a, b) => a[0] - b[0]);
    for (const [, mark] of marks) {
      const tip = pixel(mark.point);
      pen.globalAlpha = seen(mark) ? 1 : 0.2;
      pen.strokeStyle = pen.fillStyle = "rgb(0,72,160)";
      pen.lineWidth = 1.5;
      if (mark.rim) {
        pen.beginPath(); mark.rim.forEach((p) => pen.lineTo(...pixel(p))); pen.closePath();
        pen.stroke(); pen.globalAlpha *= 0.25; pen.fill(); pen.globalAlpha *= 4;
      }
      if (mark.force) arrow(pixel(sub(mark.point, mark.force)), tip);
      const size = mark.label ? 8 : 3.5, free = mark.label && seen(mark) ? beside(tip) : tip;
      if (free !== tip) { pen.lineWidth = 1; pen.beginPath(); pen.moveTo(...tip); pen.lineTo(...free); pen.stroke(); }
      pen.beginPath(); pen.arc(...free, size, 0, 7); pen.fill();
      if (mark.label) {
        pen.fillStyle = "#fff"; pen.font = "600 10px system-ui, sans-serif";
        pen.textAlign = "center"; pen.textBaseline = "middle"; pen.fillText(mark.label, ...free);
      }
      pen.globalAlpha = 1;
      if (seen(mark)) placed.push([free, size + 3, mark.said]);
    }
    axes(pixel, [right, up], wide, high);
  }
  function beside(tip) {  // the nearest place on a spiral where no number lies yet
    const taken = ([x, y]) => placed.some(([p]) => Math.hypot(p[0] - x, p[1] - y) < 17);
    let place = tip;
    for (let k = 1; k < 60 && taken(place); k++) {
      place = [tip[0] + 3 * Math.sqrt(k) * 2 * Math.cos(2.4 * k), tip[1] + 3 * Math.sqrt(k) * 2 * Math.sin(2.4 * k)];
    }
    return place;
  }
  function arrow(tail, tip) {
    const way = [tip[0] - tail[0], tip[1] - tail[1]], long = Math.hypot(...way);
    if (long < 2) return;
    const [x, y] = [way[0] / long, way[1] / long], head = Math.min(10, 0.6 * long);
    pen.lineWidth = 2.5;
    pen.beginPath(); pen.moveTo(...tail); pen.lineTo(tip[0] - head * x, tip[1] - head * y); pen.stroke();
    pen.beginPath(); pen.moveTo(...tip);
    pen.lineTo(tip[0] - head * x + 0.45 * head * y, tip[1] - head * y - 0.45 * head * x);
    pen.lineTo(tip[0] - head * x - 0.45 * head * y, tip[1] - head * y + 0.45 * head * x);
    pen.closePath(); pen.fill();
  }
  function axes(pixel, [right, up], wide, high) {
    const corner = [34, high - 34];
    ["#d55e00", "#009e73", "#0072b2"].forEach((ink, k) => {
      const end = [corner[0] + 24 * right[k], corner[1] - 24 * up[k]];
      pen.strokeStyle = pen.fillStyle = ink; pen.lineWidth = 1.5;
      pen.beginPath(); pen.moveTo(...corner); pen.lineTo(...end); pen.stroke();
      pen.font = "11px system-ui, sans-serif"; pen.textAlign = "center"; pen.textBaseline = "middle";
      pen.fillText("xyz"[k], corner[0] + 31 * right[k], corner[1] - 31 * up[k]);
    });
    pen.fillStyle = theme(); pen.textAlign = "right"; pen.fillText(data.size, wide - 8, high - 10);
  }
  const again = () => { if (!asked) { asked = true; requestAnimationFrame(draw); } };
  const turn = (x, y) => {
    view.turn -= x; view.rise = Math.max(-1.55, Math.min(1.55, view.rise + y)); tip.hidden = true; again();
  };
  let last = null;
  canvas.addEventListener("pointerdown", (event) => { last = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointerup", () => { last = null; });
  canvas.addEventListener("pointercancel", () => { last = null; });
  canvas.addEventListener("pointermove", (event) => {
    if (last) { turn(0.01 * (event.clientX - last[0]), 0.01 * (event.clientY - last[1])); last = [event.clientX, event.clientY]; return; }
    const box = canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    const over = placed.findLast(([p, size]) => Math.hypot(p[0] - x, p[1] - y) < size);
    tip.hidden = !over;
    if (over) {
      tip.textContent = over[2];
      tip.style.left = `${Math.min(x + 12, Math.max(0, box.width - tip.offsetWidth - 4))}px`;
      tip.style.top = `${Math.max(0, Math.min(y + 12, box.height - tip.offsetHeight))}px`;
    }
  });
  canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
  canvas.addEventListener("dblclick", () => { view = { ...first }; again(); });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (step) turn(...step);
    else if (event.key === "+" || event.key === "=") view.near *= 1.2;
    else if (event.key === "-") view.near /= 1.2;
    else if (event.key === "0") view = { ...first };
    else return;
    event.preventDefault(); again();
  });
  new ResizeObserver(again).observe(canvas);
  box.hidden = false;
  again();
})(document.currentScript.parentElement);
