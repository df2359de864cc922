"""Breaks of files that go out and come in, robots, text encoders, analysis and conversions, for `tools/mutate.py`."""
RATES, POINTS, FILM = (f"tests/export/test_{name}.py" for name in ("rates", "points", "film"))
ROBOTS, DESCRIBE = "tests/robots/test_robots.py", "tests/analysis/test_describe.py"
SAYS = f"{DESCRIBE}::test_says_what_is_done_of_a_mirror_image_with_sides_exchanged_and_at_any_rate"
ENCODER, CONVERT = "tests/text/test_encoder.py", "tests/convert/test_convert.py"

MUTATIONS = (
    # --- times and rates of readers and writers -------------------------------------------------------------------
    ("export-uneven-times", "motion_jax/export/points.py", "steps.max() < 1.1 * steps.min()",
     "steps.max() < 11 * steps.min()", (f"{RATES}::test_without_a_rate_it_is_read_off_the_times",)),
    ("export-rate-of-zero", "motion_jax/export/points.py", "skeleton.fps if fps is None else fps",
     "fps or skeleton.fps", (f"{RATES}::test_a_rate_that_no_motion_has_is_refused",)),
    ("export-trc-rate", "motion_jax/export/points.py", 'f"{clip.fps:.10g}", clip.num_frames',
     'f"{clip.skeleton.fps:.10g}", clip.num_frames', (f"{RATES}::test_every_file_states_the_rate_of_its_frames",)),
    ("export-page-rate", "motion_jax/export/html.py", '"fps": clip.fps,', '"fps": 20.0,',
     ("tests/export/test_html.py::test_page_holds_the_motion",)),
    ("export-gif-time", "motion_jax/export/gif.py", "end = round(number / fps * 100)",
     "end = ended + round(100 / fps)", ("tests/export/test_gif.py::test_pictures_come_back",)),
    ("export-film-colours", "motion_jax/export/video.py", "np.arange(len(joints)) * (clip.fps / fps)",
     "np.arange(len(joints)) * (fps / clip.fps)", (f"{FILM}::test_a_film_at_another_rate_lasts_as_long",)),
    ("export-robot-side-car-rate", "motion_jax/robots/formats.py",
     "type(value) in (int, float) and FRAME_RATES[0] <= value <= FRAME_RATES[1]",
     "type(value) in (int, float)", (f"{ROBOTS}::test_a_csv_is_read_back_at_the_rate_of_its_side_car",)),
    ("export-robot-rate", "motion_jax/robots/motion.py", "part = (time - low)[:, None]",
     "part = np.round(time - low)[:, None]", (f"{ROBOTS}::test_a_csv_is_read_back_at_the_rate_of_its_side_car",)),
    # --- files ----------------------------------------------------------------------------------------------------
    ("export-gap", "motion_jax/export/points.py", "if off.max() > 1e-4 * size:", "if False:",
     (f"{POINTS}::test_a_gap_is_named",)),
    ("export-t-pose-floor", "motion_jax/export/rig.py", "floor - low, pose.root[0, 2]", "floor, pose.root[0, 2]",
     (f"{RATES}::test_the_command_line_writes_rates_and_a_t_pose",)),
    ("export-character-t-pose", "motion_jax/export/character/posing.py",
     "    at[..., 1] -= _sole_height(figure, still, at)[0]\n", "",
     ("tests/export/test_character.py::test_feet_of_other_proportions_stand_on_the_floor_and_do_not_slide",)),
    ("export-loop-around", "motion_jax/export/rig.py", "if looping.is_loop(places, skeleton) else solve(places)",
     "if False else solve(places)",
     ("tests/export/test_engines.py::test_the_last_key_of_a_loop_is_the_first_at_the_clips_length",)),
    ("export-new-clips-first", "motion_jax/export/character/__init__.py", "[*added, *there]", "[*there, *added]",
     ("tests/export/test_engines.py::test_clips_have_names_without_blanks_and_new_ones_come_first",)),
    ("export-clothes", "motion_jax/export/character/figure.py",
     "copies.setdefault(nodes[i], []).append(nodes[twins[names[i]]])", "pass",
     ("tests/export/test_character.py::test_clothes_with_a_skeleton_of_their_own_move_along",)),
    # --- robots ---------------------------------------------------------------------------------------------------
    ("export-gmr-quaternion", "motion_jax/robots/formats.py",
     '"root_rot": np.roll(motion.qpos[:, 3:7], -1, axis=1), "dof_pos"', '"root_rot": motion.qpos[:, 3:7], "dof_pos"',
     (f"{ROBOTS}::test_npz_formats_hold_the_motion",)),
    ("export-robot-seams", "motion_jax/robots/report.py", "steps[max(frame - 10, 0):frame + 10]",
     "steps[frame:frame + 10]", (f"{ROBOTS}::test_a_report_measures_slide_depth_and_steps",)),
    # --- analysis -------------------------------------------------------------------------------------------------
    ("export-hop-side", "motion_jax/analysis/events.py", '"hop", SIDES[one[0]]', '"hop", SIDES[1 - one[0]]', (SAYS,)),
    ("export-arm-circle-way", "motion_jax/analysis/events.py", 'way="backward" if own > 0 else "forward"',
     'way="forward" if own > 0 else "backward"', (SAYS,)),
    ("export-reach-side", "motion_jax/analysis/events.py", "SIDES[int(lowest.argmin())]",
     "SIDES[int(lowest.argmax())]", (SAYS,)),
    ("export-u-turn-side", "motion_jax/analysis/events.py", "150 <= abs(total) <= 210", "150 <= total <= 210",
     (SAYS,)),
    # --- text and conversions -------------------------------------------------------------------------------------
    ("export-max-words", "motion_jax/text/encoder.py", "if len(ids) > self.max_words:",
     "if len(ids) >= self.max_words:", (f"{ENCODER}::test_bad_sizes",)),
    ("export-synonym", "motion_jax/text/encoder.py", "if nearness.max() >= SYNONYM else", "if True else",
     (f"{ENCODER}::test_synonyms_are_near_enough",)),
    ("export-infinite-weights", "motion_jax/convert/parts.py", "if not np.isfinite(array).all()]",
     "if np.isnan(array).any()]", (f"{CONVERT}::test_a_wrong_file_or_flag_is_one_line_and_leaves_nothing",)),
    ("export-compiled-modules", "motion_jax/convert/parts.py", r"(?:(?:module|_orig_mod)\.)+", r"(?:(?:module)\.)+",
     (f"{CONVERT}::test_another_kind_of_checkpoint_is_told",)),
    ("export-heads", "motion_jax/convert/parts.py", "if heads < 1 or width % heads:", "if heads < 1:",
     (f"{CONVERT}::test_a_wrong_file_or_flag_is_one_line_and_leaves_nothing",)),
)
