"""What `tools/mutate.py` breaks in language, plans and checks of the studio, and in constraints; see core.py."""
SENTENCES = "tests/studio/language/test_plans.py"
VIOLATIONS, POSTURES, PATHS = (f"tests/studio/checks/test_{name}violations.py" for name in ("", "posture_", "path_"))
SEQUENCING = "tests/studio/planning/test_sequencing.py"
CONSTRAINTS, CONDITIONING = "tests/control/test_constraints.py", "tests/control/test_conditioning.py"

MUTATIONS = (
    # --- language -------------------------------------------------------------------------------------------------
    ("language-more-than-twice", "motion_jax_studio/language/counting.py", r"(?<!than )(?<!at )\b(once|twice|thrice)",
     r"(?<!at )\b(once|twice|thrice)", (f"{SENTENCES}::test_sentences_are_parted_into_their_actions_or_stay_whole",)),
    ("language-two-people", "motion_jax_studio/language/ordering.py",
     'if {"he", "she"} <= {words[-1] for words in subjects}:', "if False:",
     (f"{SENTENCES}::test_sentences_are_parted_into_their_actions_or_stay_whole",)),
    ("language-negation", "motion_jax_studio/language/requirements.py",
     "if lexicon.NEGATIONS & set(text.lower().split()):", "if False:",
     (f"{VIOLATIONS}::test_what_sentences_require_that_can_be_measured",)),
    # --- planning -------------------------------------------------------------------------------------------------
    ("language-way-back", "motion_jax_studio/planning/durations.py", "away if segment.action.goes_back and away else",
     "away if False else", (f"{SEQUENCING}::test_a_way_back_takes_as_long_as_the_way",)),
    ("language-held-wrist", "motion_jax_studio/planning/pauses.py", 'enumerate(("right", "left"))',
     'enumerate(("left", "right"))', (f"{SEQUENCING}::test_who_holds_a_pose_holds_it_where_it_is",)),
    ("language-mirrored", "motion_jax_studio/posing/corrections.py", "not sided or len(named) != len(sided) or",
     "not sided or", ("tests/studio/posing/test_corrections.py::"
                      "test_a_side_is_not_exchanged_where_something_else_is_of_one_side",)),
    # --- checks ---------------------------------------------------------------------------------------------------
    ("language-both-sides", "motion_jax_studio/checks/violations.py", 'or event.side == "both")', "or False)",
     (f"{VIOLATIONS}::test_an_event_of_both_sides_is_one_of_either",)),
    ("language-still-head", "motion_jax_studio/checks/violations.py", "[10, 11, 15, 20, 21]", "[10, 11, 20, 21]",
     (f"{VIOLATIONS}::test_what_is_missing_is_counted",)),
    ("language-balance", "motion_jax_studio/checks/posture_violations.py", "up[:, 1 - foot] & ~up[:, foot]",
     "up[:, 1 - foot]", (f"{POSTURES}::test_a_body_that_does_it_and_one_that_does_not",)),
    ("language-half-circle", "motion_jax_studio/checks/path_violations.py",
     "max(least - abs(total), abs(total) - most, 0.0)", "max(least - abs(total), 0.0)",
     (f"{PATHS}::test_half_a_circle_zigzags_and_straight_ways",)),
    ("language-first-of-equals", "motion_jax_studio/checks/best_of.py", "attempt.score < attempts[kept].score",
     "attempt.score <= attempts[kept].score",
     ("tests/studio/test_resampling.py::test_of_equals_the_first_is_kept_and_all_attempts_are_recorded",)),
    # --- pipeline, streams, edits -----------------------------------------------------------------------------------
    ("language-cleanup", "motion_jax_studio/pipeline.py", "      if steps.name_of(step) in out:", "      if False:",
     ("tests/studio/test_pipeline.py::"
      "test_sampling_alone_is_the_models_generate_one_motion_of_a_prompt_and_several_of_a_list",)),
    ("step-records-cm", "motion_jax/motion/step_records.py", "100 * float(away.max())", "100 * float(away.mean())",
     ("tests/motion/test_step_records.py::test_a_change_is_measured_in_frames_centimetres_and_degrees",)),
    ("language-fork", "motion_jax_studio/streaming.py",
     "self.live.fork(num_frames), self._pipeline, self.prompt, self._out, self._hold_until_done)",
     "self.live.fork(num_frames), self._pipeline, self._out)",
     ("tests/studio/test_streaming.py::test_pauses_and_prompts_that_wait",)),
    ("language-gliding-run", "motion_jax_studio/editing.py",
     'not checked or any(requirement.kind == "run" for requirement in requirements) or', "not checked or",
     ("tests/studio/test_editing.py::test_a_body_that_glides_is_reported",)),
    ("language-constrained-plan", "motion_jax_studio/steps.py",
     "plan if is_constrained(constraints) else job.planner.with_postures(plan)", "job.planner.with_postures(plan)",
     ("tests/studio/posing/test_postures.py::test_plans_with_constraints_stay_as_they_are",)),
    # --- control --------------------------------------------------------------------------------------------------
    ("language-circle-left", "motion_jax/control/paths.py", "return _walked(_round(radius, 1), fps, SPEED)",
     "return _walked(_round(radius, -1), fps, SPEED)", (f"{CONSTRAINTS}::test_standard_curves_lead_to_their_sides",)),
    ("language-file-size", "motion_jax/control/files.py", "if path.stat().st_size > MOST_BYTES:", "if False:",
     (f"{CONSTRAINTS}::test_a_file_that_is_too_large_is_not_read",)),
    ("language-hand-speed", "motion_jax/control/compiling.py", "(1.0 if joint == 0 else 2.5)", "1.0",
     ("tests/control/test_poses.py::test_a_hand_is_flung_faster_than_a_body_runs",)),
    ("language-half-turn", "motion_jax/control/guidance.py",
     "turn = jnp.where(jnp.cos(heading - signal.heading) < 0, jnp.sign(turn), turn)", "pass",
     ("tests/control/test_guidance.py::"
      "test_a_heading_that_is_more_than_a_quarter_turn_off_pulls_with_all_its_force",)),
    ("language-horizon", "motion_jax/control/conditioning.py", "visible = (at < frames) & (at - last <= HORIZON)",
     "visible = at < frames",
     (f"{CONDITIONING}::test_goals_ahead_are_seen_before_they_come_and_no_farther_than_the_horizon",)),
    ("language-smoothest-loop", "motion_jax/control/finishing.py",
     "best = min(loops, key=lambda loop: _roughness(loop, fps))", "best = next(loops)",
     ("tests/control/test_loops.py::test_of_cycles_that_meet_well_that_with_the_smoothest_seam_is_taken",)),
)
