"""The application and pictures: the server and its checks, the command line, drawings, charts. See core.py."""
SERVER = "tests/studio/server/test_"
SECURITY, MMCP, STREAMS = f"{SERVER}security.py", f"{SERVER}mmcp.py", f"{SERVER}streams.py"

MUTATIONS = (
    # --- what the server refuses ----------------------------------------------------------------------------------
    ("application-mmcp-token", "motion_studio/server/security.py", 'startswith(("/v1/", "/mmcp/"))',
     'startswith("/v1/")', (f"{SECURITY}::test_without_the_token_there_is_nothing",)),
    ("application-burst", "motion_studio/server/limits.py", "min(3 * self._rate, self._left + ", "(self._left + ",
     (f"{SECURITY}::test_a_bucket_fills_again",)),
    ("application-token-of-a-group", "motion_studio/server/server.py", "st_mode & 0o077", "st_mode & 0o007",
     (f"{SERVER}server.py::test_the_token_is_kept_for_the_user_alone",)),
    ("application-acknowledged-ahead", "motion_studio/server/streams.py", "min(request.sequence, self._sequence - 1)",
     "request.sequence", (f"{STREAMS}::test_a_page_that_does_not_read_stops_the_sampling",)),
    ("application-project-size", "motion_studio/server/project.py", "if path.stat().st_size > limits.body_bytes:",
     "if False:", (f"{SERVER}project.py::test_what_is_no_project_is_told_in_one_line",)),
    ("application-kept-frames", "motion_studio/server/fields.py", "if frames > limits.frames:", "if False:",
     (f"{SERVER}fields.py::test_motions_of_control_have_a_limit_of_frames",)),
    ("application-failed-model", "motion_studio/server/library.py",
     'if slot.model is None or slot.state == "failed":', 'if slot.state == "waiting":',
     (f"{SERVER}server.py::test_a_model_that_fails_leaves_the_others",)),
    # --- what it makes --------------------------------------------------------------------------------------------
    ("application-story-cleanup", "motion_studio/server/multi_prompt.py", "seed, cleanup, tuple(sorted(",
     "seed, tuple(sorted(", (f"{SERVER}multi_prompt.py::test_other_seeds_choices_and_old_takes_are_kept_apart",)),
    ("application-feet", "motion_studio/server/mmcp.py", "{name: stands[:, i].tolist()",
     "{name: stands[:, -1 - i].tolist()", (f"{MMCP}::test_a_reply_names_the_feet_that_stand",)),
    ("application-pose-on-the-floor", "motion_studio/server/mmcp_constraints.py",
     "joints[:, 1] -= joints[:, 1].min()", "pass", (f"{MMCP}::test_a_pose_of_mmcp_is_turned_as_replies_are",)),
    ("application-seed-of-a-sample", "motion_studio/cli/make.py",
     "seeds = [args.seed + i % args.num_samples for i in range(len(rows))]",
     "seeds = [args.seed + i for i in range(len(rows))]",
     ("tests/studio/cli/test_cli.py::test_motions_come_in_pieces_with_a_seed_for_each_sample",)),
    ("application-slice", "motion_studio/cli/sweep.py",
     "return one, share if share - end < (self._slice or 0) / 2 else end", "return one, end",
     ("tests/studio/cli/test_sweep.py",)),
    ("application-slice-command", "motion_studio/cli/sweep.py", 'command[command.index("train"):]', "command[3:]",
     ("tests/studio/cli/test_sweep.py::test_runs_come_one_after_another_and_only_once",)),
    # --- pictures -------------------------------------------------------------------------------------------------
    ("application-mask-axes", "motion_jax/draw.py", '_cells(cells, title, "key", "query")',
     '_cells(cells, title, "query", "key")', ("tests/test_draw.py",)),
    ("application-source-row", "motion_jax/pictures.py", '((source, "source"), (back, "there and back"))',
     '((back, "source"), (source, "there and back"))',
     ("tests/test_pictures.py::test_a_tokenizers_picture_has_each_window_above_what_comes_back",)),
    ("application-chart-colours", "motion_jax/charts.py", "(len(found) - found.count('real')) % 5", "len(found) % 5",
     ("tests/test_charts.py::test_reports_and_charts_share_their_colours",)),
)
