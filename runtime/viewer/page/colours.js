// Runs in the page. It adds to viser's client what that lacks:
//
// * Vertex colours of a mesh that change with every frame. The server sends them as those of an invisible point cloud
//   with as many points, NAME_colours beside the mesh NAME; here the mesh takes over the cloud's buffer.
// * Drags at the rate of the display, in place of 20 a second.
//
// It relies on what the client of viser 1.1 offers to its own tests, window.__viserMutable; without that the body has one
// colour, and drags come at 20 a second.
(() => {
  const SUFFIX = "_colours";
  if (window.__softprint) return;
  const state = (window.__softprint = { frames: 0, coloured: 0 });

  const meshOf = (node) => {
    let found = null;
    node?.traverse?.((object) => {
      if (found === null && object.isMesh && object.geometry?.index) found = object;
    });
    return found;
  };
  const cloudOf = (node) => {
    let found = null;
    node?.traverse?.((object) => {
      if (found === null && object.isPoints) found = object;
    });
    return found;
  };

  const colour = (viewer) => {
    let coloured = 0;
    for (const name of Object.keys(viewer.nodeRefFromName)) {
      if (!name.endsWith(SUFFIX)) continue;
      const mesh = meshOf(viewer.nodeRefFromName[name.slice(0, -SUFFIX.length)]);
      const cloud = cloudOf(viewer.nodeRefFromName[name]);
      const colours = cloud?.geometry?.attributes?.color;
      if (!mesh || !colours || colours.count !== mesh.geometry.attributes.position.count) continue;
      if (mesh.geometry.attributes.color !== colours) mesh.geometry.setAttribute("color", colours);
      if (!mesh.material.vertexColors) {
        mesh.material.vertexColors = true;
        mesh.material.needsUpdate = true;
      }
      mesh.material.color.setRGB(1, 1, 1);
      coloured += 1;
    }
    state.coloured = coloured;
  };

  // The gizmo that this browser drags, and the pose that was sent last. Only its own drags may be sent: the others'
  // come back from the server.
  let dragged = null;
  let sent = "";
  const listen = (viewer) => {
    const send = viewer.sendMessage;
    if (send === undefined || send.softprint) return;
    const listening = (message) => {
      if (message.type === "TransformControlsDragStartMessage") dragged = message;
      if (message.type === "TransformControlsDragEndMessage") dragged = null;
      send(message);
    };
    listening.softprint = true;
    viewer.sendMessage = listening;
  };
  const drag = (viewer) => {
    const pose = dragged && viewer.nodePoseData[dragged.name];
    if (!pose) return;
    const now = JSON.stringify([pose.wxyz, pose.position]);
    if (now === sent) return;
    sent = now;
    viewer.sendMessage({
      type: "TransformControlsUpdateMessage",
      name: dragged.name,
      owner: dragged.owner,
      wxyz: [...pose.wxyz],
      position: [...pose.position],
    });
  };

  const frame = () => {
    const viewer = window.__viserMutable;
    if (viewer) {
      state.frames += 1;
      try {
        listen(viewer);
        drag(viewer);
        colour(viewer);
      } catch (error) {
        state.error = String(error);
      }
    }
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
})();
