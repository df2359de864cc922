"""The two papers' networks, quantizers, samplers and losses: see core.py."""
MASKS, ATTENTION, DIT, VAE, TRANSFORMER, AUTOENCODER = (f"tests/nets/test_{name}.py" for name in (
    "masks", "attention", "causal_dit", "causal_vae", "masked_transformer", "autoencoder"))
RVQ, DDPM, PATHS, LATENTS = ("tests/quant/test_rvq.py", "tests/diffusion/test_ddpm.py", "tests/diffusion/test_paths.py",
                             "tests/test_latents.py")
STREAMING, PROMPTS, SELF = (f"tests/models/cmdm/test_{name}.py" for name in (
    "streaming", "multi_prompt", "self_forcing"))
GOLDEN, GENERATOR = (f"tests/models/cdamd/test_cdamd_{name}.py" for name in ("golden", "generator"))

MUTATIONS = (
    # --- attention and its masks at borders -----------------------------------------------------------------------
    ("papers-padding-border", "motion_jax/nets/masks.py", "[None, :] < lengths[:, None]",
     "[None, :] <= lengths[:, None]", (f"{MASKS}::test_padding",)),
    ("papers-rotary-sign", "motion_jax/nets/attention.py", "even * cos - odd * sin", "even * cos + odd * sin",
     (f"{DIT}::test_golden[dit_tables-float32]",)),
    ("papers-padded-key", "motion_jax/nets/attention.py", "(0, odd_rows), (0, odd_keys)))",
     "(0, odd_rows), (0, odd_keys)), constant_values=True)",
     (f"{ATTENTION}::test_fused_attention_is_the_plain_one_where_there_is_no_such_kernel",)),
    ("papers-window-words", "motion_jax/nets/masked_transformer.py", "jnp.broadcast_to(text_mask[:, None, None], (x",
     "jnp.broadcast_to(True, (x", (f"{TRANSFORMER}::test_words_beyond_one_are_seen_unless_padding",)),
    # --- what enters the networks ---------------------------------------------------------------------------------
    ("papers-block-times", "motion_jax/nets/causal_dit.py", "t = jnp.repeat(t, length // t.shape[1], axis=1)",
     "t = jnp.tile(t, (1, length // t.shape[1]))", (f"{DIT}::test_one_time_per_block_is_one_per_latent",)),
    ("papers-time-scale", "motion_jax/nets/causal_dit.py", "else t * self.time_scale", "else t / self.time_scale",
     (f"{DIT}::test_one_time_per_block_is_one_per_latent",)),
    ("papers-text-scale", "motion_jax/nets/masked_transformer.py", "text_emb.astype(self.dtype) * self.text_scale",
     "text_emb.astype(self.dtype)", (f"{TRANSFORMER}::test_words_beyond_one_are_seen_unless_padding",)),
    ("papers-level-rows", "motion_jax/nets/masked_transformer.py", "self.level_table[:codes.shape[-1]]).mean(-2)",
     "self.level_table[:codes.shape[-1]]).sum(-2)", (
         f"{TRANSFORMER}::test_a_dropped_prior_is_no_prior_and_one_level_has_no_row_of_its_own",)),
    ("papers-half-a-pair", "motion_jax/nets/convs.py", "real_mask[:, 1::2]", "real_mask[:, ::2]",
     (f"{AUTOENCODER}::test_hidden_padding_is_no_padding",)),
    # --- codes and latents ----------------------------------------------------------------------------------------
    ("papers-idle-level", "motion_jax/quant/rvq.py", "    codes = jnp.where(active, codes, 0.0)\n", "",
     (f"{RVQ}::test_gradient_comes_once_per_active_level_or_once",)),
    ("papers-first-code", "motion_jax/quant/rvq.py", "indices[..., level, None] >= 0", "indices[..., level, None] > 0",
     (f"{RVQ}::test_decoding_adds_up_the_codes_that_are_named",)),
    ("papers-fitted-padding", "motion_jax/latents.py", "yield padded, len(clip) // self.frames_per_latent",
     "yield padded, -(-len(clip) // self.frames_per_latent)",
     (f"{LATENTS}::test_fitted_latents_have_mean_0_and_variance_1",)),
    ("papers-streamed-scale", "motion_jax/latents.py", "self.unscale(latents), state, method", "latents, state, method",
     (f"{LATENTS}::test_a_stream_of_latents_decodes_as_the_whole",)),
    # --- diffusion ------------------------------------------------------------------------------------------------
    ("papers-ddim-order", "motion_jax/diffusion/ddpm.py", "before = np.append(end, schedule.alphas_cumprod[:-1])",
     "before = np.append(schedule.alphas_cumprod[1:], end)", (f"{DDPM}::test_the_way_back_ends_at_the_data",)),
    ("papers-contrast-side", "motion_jax/diffusion/paths.py", "margin + error - other", "margin + other - error",
     (f"{PATHS}::test_further_terms_weigh_a_clip_by_its_real_latents",)),
    ("papers-term-weight", "motion_jax/diffusion/paths.py", "(errors * latent_mask.sum(1)).sum()", "errors.sum()",
     (f"{PATHS}::test_further_terms_weigh_a_clip_by_its_real_latents",)),
    # --- sampling and its training --------------------------------------------------------------------------------
    ("papers-first-words", "motion_jax/models/cmdm/plan.py", "xp.where(begins == 0, _ANY, begins - plan.memory)",
     "begins - plan.memory", (f"{STREAMING}::test_what_a_window_shows_and_a_block_sees",)),
    ("papers-sixth-caption", "motion_jax/models/cmdm/offline.py",
     "self._shown[row, places[row]] = np.array(index)[own]", "pass", (
         f"{PROMPTS}::test_several_prompts_are_one_motion_and_a_stream_says_the_same",)),
    ("papers-own-past", "motion_jax/models/cmdm/stages.py", "minval=0.5", "minval=0.0",
     (f"{SELF}::test_a_beginning_of_whole_blocks_is_its_own_and_clean_and_has_no_gradient",)),
    ("papers-cdamd-guidance", "motion_jax/models/cdamd/sampling.py", "guidance.combine(with_text, without, scale)",
     "guidance.combine(without, with_text, scale)", (f"{GOLDEN}::test_golden[generate-float64]",)),
)
