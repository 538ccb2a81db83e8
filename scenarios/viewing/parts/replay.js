(async () => {
  const bytes = Uint8Array.from(atob(PACKED), (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  const lengths = new DataView(buffer);
  for (let at = 0; at < buffer.byteLength;) {
    const length = lengths.getUint32(at, true);
    viewer.handle_command_bytearray(new Uint8Array(buffer, at + 4, length));
    at += 4 + length;
  }

  const animator = viewer.animator;
  const element = (id) => document.getElementById(id);
  const captions = NARRATION.captions, forces = NARRATION.forces;
  const end = Math.max(animator.duration, 0.001);
  element("told-title").textContent = NARRATION.title;
  element("told-outcome").textContent = NARRATION.outcome;
  element("told-outcome").className = NARRATION.good ? "good" : "bad";

  // The line of time: a part for each caption, which is gone to by a click.
  const colours = ["#cfe3ec", "#d9ead3", "#fbe5c8", "#e5d9f2", "#f6d5d5", "#d8ece8", "#ece8d0", "#dfe3ea"];
  const names = [...new Set(captions.map((caption) => caption.name))];
  const line = element("line");
  const part = (from, to, text, colour) => {
    const made = document.createElement("span");
    made.style.width = `${100 * (to - from) / end}%`;
    made.style.background = colour;
    made.textContent = made.title = text;
    line.insertBefore(made, element("place"));
  };
  if (captions.length) part(0, captions[0].start_s, "", "#eee");
  captions.forEach((caption, number) => {
    const to = number + 1 < captions.length ? captions[number + 1].start_s : end;
    part(caption.start_s, to, caption.name, colours[names.indexOf(caption.name) % colours.length]);
  });

  const latest = (list, time, at) => {
    let found = null;
    for (const each of list) {
      if (at(each) > time + 1e-6) break;
      found = each;
    }
    return found;
  };
  const go = (time) => {
    animator.seek(time);
    animator.display_progress(time);
    viewer.set_dirty();
  };
  line.addEventListener("click", (event) => {
    const box = line.getBoundingClientRect();
    go(end * (event.clientX - box.left) / box.width);
  });
  // An animation that has come to its end starts anew; `playing` is Meshcat's own.
  element("play").addEventListener("click", () => animator.playing ? animator.pause() : animator.play());

  // Near what it handles the view comes closer to the hand, until somebody turns it himself.
  const hand = viewer.scene_tree.find(["drake", "visualizer", "panda", "panda_hand"]).object;
  const controls = viewer.controls, camera = viewer.camera;
  const far = {target: controls.target.clone(), offset: null};
  const place = new MeshCat.THREE.Vector3(), wanted = new MeshCat.THREE.Vector3();
  controls.addEventListener("start", () => { element("follow").checked = false; });
  const NEAR_M = 0.55;
  function follow(caption) {
    if (!element("follow").checked || !camera.position) return;
    const offset = camera.position.clone().sub(controls.target);
    if (far.offset === null) far.offset = offset.clone();
    hand.getWorldPosition(place);
    const near = caption !== null && caption.near;
    wanted.copy(near ? place : far.target);
    const distance = near ? Math.min(NEAR_M, far.offset.length()) : far.offset.length();
    const goal = wanted.clone().add(far.offset.clone().setLength(distance));
    if (controls.target.distanceTo(wanted) + camera.position.distanceTo(goal) < 1e-3) return;
    controls.target.lerp(wanted, 0.08);
    camera.position.lerp(goal, 0.08);
    viewer.set_dirty();
  }

  function tell() {
    const time = animator.time;
    const caption = latest(captions, time, (each) => each.start_s);
    const felt = latest(forces, time, (each) => each[0]);
    element("told-now").textContent =
      (caption ? `attempt ${caption.attempt}, ${caption.name}, ` : "") + `${time.toFixed(1)} s of ${end.toFixed(1)}`;
    element("told-forces").textContent =
      felt ? `fingers ${felt[1].toFixed(0)} N and ${felt[2].toFixed(0)} N` : "";
    element("place").style.left = `${100 * Math.min(time / end, 1)}%`;
    element("play").textContent = animator.playing ? "pause" : "play";
    follow(caption);
    requestAnimationFrame(tell);
  }
  requestAnimationFrame(tell);

  // `#t=12.5` starts there.
  const asked = /^#t=([0-9.]+)$/.exec(location.hash);
  if (asked) go(Math.min(parseFloat(asked[1]), end));
  window.addEventListener("hashchange", () => {
    const found = /^#t=([0-9.]+)$/.exec(location.hash);
    if (found) go(Math.min(parseFloat(found[1]), end));
  });
})();
