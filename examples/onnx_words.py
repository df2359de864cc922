"""BERT's word pieces of a sentence, from the table in model.json of exported graphs; used by onnx_stream.py."""
import re
import sys
import unicodedata


def word_pieces(table, sentence, most):
  """Numbers of the pieces, special ones included, at most `most`; lower case, no accents, longest pieces first."""
  number = {piece: i for i, piece in enumerate(table["pieces"])}
  text = "".join(c for c in unicodedata.normalize("NFD", sentence.lower()) if unicodedata.category(c) != "Mn")
  ids = []
  for word in re.findall(r"[^\W_]+|[^\w\s]|_", text):
    found, at = [], 0
    while at < len(word):
      mark = "##" if at else ""
      end = next((end for end in range(len(word), at, -1) if mark + word[at:end] in number), None)
      if end is None:
        found = [table["unknown"]]
        break
      found.append(number[mark + word[at:end]])
      at = end
    ids += found
  return [table["first"], *ids[:most - 2], table["last"]]


if __name__ == "__main__":
  import json
  print(word_pieces(json.load(open(sys.argv[1], encoding="utf-8"))["tokenizer"], sys.argv[2], 64))
