"""motion-jax retrieve: find clips by text, and captions by motion."""
from motion_jax.utils.numerals import MOTIONS, whole
from motion_jax_studio.cli import reading, writing


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  retrieve = commands.add_parser("retrieve", help="find clips nearest to a sentence, or captions nearest to a motion")
  retrieve.add_argument("query", nargs="?",
                        help=f"a sentence, or a motion file ({reading.MOTION_HELP}); without a query, the recall over "
                             "the whole collection is printed")
  retrieve.add_argument("--data", required=True, metavar="DIR", help="an archive or a HumanML3D-layout folder")
  retrieve.add_argument("--split", help="train, val or test (default: all)")
  retrieve.add_argument("--top-k", type=whole(*MOTIONS), default=5, help="number of results (5)")
  retrieve.add_argument("--teacher", default="part-tmr-small", help="a run folder or a shipped model (part-tmr-small)")
  reading.add_reading(retrieve)
  writing.add_out(retrieve, None, "nearest.html,nearest.bvh; the nearest clip")
  writing.add_rig(retrieve)
  retrieve.set_defaults(run=_retrieve)


def _print_recall(scores):
  for direction, prefix in (("text to motion", ""), ("motion to text", "back_")):
    values = [f"at {k} {100 * scores[f'{prefix}r{k}']:.1f} %" for k in (1, 2, 3, 5, 10)]
    print(f"{direction}: {', '.join(values)}; median rank {scores[f'{prefix}median_rank']:g}")


def _retrieve(args):
  output = writing.Output(args) if args.out else None
  is_file = args.query is not None and args.query.lower().endswith(reading.MOTION_FILES)
  query = reading.read_motion(args.query, args) if is_file else None  # before the slow part
  if args.out and (query is not None or args.query is None):
    raise ValueError("got --out without a sentence; it writes the clip nearest to one")
  from motion_jax import retrieval
  from motion_jax.utils import cache
  cache.keep_in_user_cache()
  retriever = retrieval.load(args.teacher)
  collection = retrieval.read_collection(retriever, args.data, args.split)
  print(f"{len(collection)} clips of {args.data}" + (f", split {args.split}" if args.split else ""))
  if args.query is None:
    count, scores = collection.scores()
    print(f"recall among {count} clips, one of each caption")
    _print_recall(scores)
    near = collection.near_scores(retriever)
    if near:
      print("recall if clips with nearly the same caption count as correct")
      _print_recall(near)
  elif query is not None:
    vector = retriever.embed_motion([retriever.features_of(query)])[0]
    for similarity, caption in collection.nearest_captions(vector, args.top_k):
      print(f"{similarity:6.3f}  {caption}")
  else:
    if not args.query.strip():
      raise ValueError("got an empty sentence; say what the person does, such as 'a person walks'")
    matches = collection.nearest_clips(retriever.embed_text([args.query])[0], args.top_k)
    for similarity, i in matches:
      print(f"{similarity:6.3f}  {collection.ids[i]:24s} {collection.seconds[i]:5.1f} s  {collection.captions[i][0]}")
    if output is not None:
      clips = retrieval.read_clips(args.data, args.split)
      output.write([clips[matches[0][1]]])
