"""Where the files of CMDM's release lie in the folder that its README describes."""
TOKENIZER = "checkpoints/t2m/pretrained_vae/model/net_best_fid.tar"
DENOISER = "checkpoints/t2m/pretrained_dit/model/latest.tar"
EVALUATORS = {259: "checkpoints/t2m/text_mot_match_full/model/finest.tar",
              67: "checkpoints/t2m/text_mot_match/model/finest.tar"}
