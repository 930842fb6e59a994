/* Things along a motion: in play they are moved in every frame of the browser, between the moments
   that the server answers for. */

const POSE = 7; // position, quaternion

export function createPoses(viewer) {
  const { Quaternion, Vector3 } = MeshCat.THREE;
  const [place, turn] = [new Vector3(), new Quaternion()];
  let [told, nodes] = [null, []];

  function load(poses) {
    told = poses;
    nodes = Object.entries(viewer ? poses.nodes : {}).map(([path, packed]) => {
      const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
      const { object } = viewer.scene_tree.find(path.split("/").filter(Boolean));
      const values = new Float32Array(bytes.buffer);
      return { object, values, size: values.length / told.rows };
    });
  }

  function show(t) {
    if (!nodes.length) return;
    const { first, last, rows } = told;
    const row = last > first ? ((t - first) / (last - first)) * (rows - 1) : 0;
    const before = Math.min(Math.max(Math.floor(row), 0), rows - 1);
    const after = Math.min(before + 1, rows - 1);
    for (const { object, values, size } of nodes) {
      const [i, j] = [before * size, after * size];
      object.position.fromArray(values, i).lerp(place.fromArray(values, j), row - before);
      if (size < POSE) continue; // a point
      object.quaternion.fromArray(values, i + 3).slerp(turn.fromArray(values, j + 3), row - before);
    }
    viewer.set_dirty();
  }

  return { load, show, of: () => told?.played };
}
