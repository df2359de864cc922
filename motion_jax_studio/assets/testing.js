// The state that tests read: window.__studio.

export function expose(studio) {
  const { live, multiPrompt, player, notes, panels } = studio;
  const read = {
    mode: () => studio.mode,
    ready: () => Boolean(studio.view),
    status: () => document.querySelector("#state span").textContent,
    time: () => studio.time(),
    frame: () => Math.round(studio.time() * (studio.mode === "live" ? live.fps : player.fps)),
    frames: () => (studio.mode === "live" ? live.frames : player.frames),
    blocks: () => studio.state.project.blocks.map((block) => ({ ...block })),
    prompts: () =>
      studio.mode === "live"
        ? live.words.map((one) => one.prompt)
        : studio.state.project.blocks.map((block) => block.prompt),
    project: () => structuredClone(studio.state.project),
    selection: () => studio.state.selected,
    span: () => studio.state.span,
    undoDepth: () => studio.state.past.length,
    redoDepth: () => studio.state.future.length,
    playing: () => (studio.mode === "live" ? live.state === "running" : player.playing),
    busy: () => multiPrompt.busy,
    // A generated motion counts once it is shown.
    stale: () => multiPrompt.stale || (studio.mode === "timeline" && multiPrompt.shown !== studio.loaded),
    reply: () => multiPrompt.reply,
    made: () => multiPrompt.shown?.meta?.made ?? null,
    takes: () => studio.state.project.seeds.map((seed, take) => ({ seed, made: Boolean(multiPrompt.of(take)) })),
    figures: () => studio.view?.figures.length ?? 0,
    size: () => studio.view?.size ?? 1,
    draws: () => studio.view?.stage.renderer.info.render.frame ?? 0,
    characters: () => ({ shown: studio.characters.shown, kept: [...studio.characters.kept.keys()] }),
    ghosts: () => studio.view?.ghosts.length ?? 0,
    steps: () => studio.view?.steps.count ?? 0,
    editColors: () => studio.view?.figures.map((figure) => figure.edited ?? null) ?? [],
    kept: () => ({ works: studio.autosave.works, pending: studio.autosave.pending, id: studio.autosave.id }),
    leaving: () => studio.leaving(),
    control: () => structuredClone(studio.state.project.control),
    report: () => multiPrompt.shown?.report ?? null,
    drawing: () => studio.tool.active,
    centre: () => [studio.view.stage.controls.target.x, studio.view.stage.controls.target.z],
    marks: () => {
      const { own, points, targets, figures } = studio.view.marks;
      return { meshes: own.length, points: points.length, targets: targets.length, poses: figures?.length ?? 0 };
    },
    keys: () => studio.desk.keys.map(({ track, frame, slack, strength }) => ({ track, frame, slack, strength })),
    selectedKeys: () => studio.desk.chosen.map(({ track, frame }) => ({ track, frame })),
    chosenHandle: () => studio.desk.tool.chosen,
    rings: () => Boolean(studio.desk.tool.known?.rings),
    previewTime: () => studio.desk.previewTime,
    preview: () => Boolean(multiPrompt.shown?.preview),
    models: () => studio.models.map(({ name, state }) => ({ name, state })),
    errors: () => [...notes.errors],
    notes: () => [...notes.all],
    exported: () => panels.last ?? null,
    window: () => ({ ...studio.timeline.window }),
    live: () => ({
      state: live.state,
      run: live.run,
      connected: live.connected,
      reconnects: live.reconnects,
      blocks: live.blocks,
      end: live.end,
      committed: live.committed,
      begun: live.begun,
      played: live.played,
      lead: live.lead,
      missed: live.missed,
      latency: live.latency,
      sampling: live.sampling,
      seed: live.choices.seed,
      words: live.words.map((one) => ({ ...one })),
      blockFrames: live.blockFrames,
      constrained: live.constrained,
      unacknowledged: live.waitingBlocks.length,
    }),
  };
  window.__studio = {
    seek: (second) => studio.seek(second),
    /** Where the bones of a character are drawn, {joint: [x, y, z]}. */
    places: () => studio.view.places(),
    /** Where on the page a point of the floor is, in pixels. */
    screenOf: (x, z) => studio.view.screenOf(x, z),
    /** Where on the page a handle of the body is, [left, top, pixels of a metre]. */
    handleAt: (handle) => studio.desk.tool.handles.onPage(studio.desk.tool.handles.dots[handle].position),
    /** Coordinates of the joints of frames from first up to past, as they are played. */
    joints(first, past) {
      const motion = studio.motion(),
        shift = studio.mode === "live" ? live.first : 0,
        k = 3 * motion.count;
      return [...motion.joints.subarray((first - shift) * k, (past - shift) * k)];
    },
  };
  for (const [name, get] of Object.entries(read))
    Object.defineProperty(window.__studio, name, { get, enumerable: true });
}
