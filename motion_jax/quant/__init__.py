"""Vector quantizers: empty until CDAMD, whose tokenizer they are."""
