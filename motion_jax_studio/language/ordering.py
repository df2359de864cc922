"""Clauses in the order of time: groups of simultaneous ones, one group after the other, all of one subject."""
from motion_jax.text.morphology import is_participle
from motion_jax_studio.language import actions, lexicon
from motion_jax_studio.language.clause import can_be_simultaneous, lower


def subject_of(clauses):
  """The words of the subject of all clauses, "a person" where none has one; None where there are several."""
  subjects = [lower(clause.subject) for clause in clauses if clause.subject]
  named = [words for words in subjects if words[-1] not in lexicon.PRONOUNS]
  if {"he", "she"} <= {words[-1] for words in subjects}:
    return None
  first = next(iter(named or subjects), lexicon.DEFAULT_SUBJECT)
  for words in named:
    is_definite = words[0] in lexicon.DETERMINERS - set(lexicon.ONE_MORE)
    if words != first and (not is_definite or set(words) & lexicon.ANOTHER_PERSON):
      return None
  return first


def in_order(clauses):
  """Lists of simultaneous clauses in the order of time, of [(connector, clause)]; None where a body cannot do it."""
  groups, in_list, subordinate, before = [], False, [], ""
  for kind, clause in clauses:
    if kind == "" or kind.startswith("lead ") or kind == "main after":
      groups.append([clause])
    elif kind == "main while":
      if not can_be_simultaneous(groups[-1], clause):
        return None  # "while walking, she turns left"
      groups[-1].append(clause)
    elif kind in ("main before", "main until"):
      subordinate, groups = groups, [[clause]]
    elif _is_said_to_be_simultaneous(kind, clause, before):
      kind = "while"
      groups.append([clause]) if not can_be_simultaneous(groups[-1], clause) else groups[-1].append(clause)
    elif kind == "and" and not in_list and _and_is_simultaneous(groups[-1], clause):
      groups[-1].append(clause)
    elif kind == "after":
      groups.insert(len(groups) - 1, [clause])
    else:
      in_list = kind == ","
      groups.append([clause])
    before = kind
  return groups + subordinate


def _is_said_to_be_simultaneous(kind, clause, before):
  """By "while", by "at the same time", by a participle after a comma, or after "and" behind one of these."""
  return kind == "while" or clause.simultaneous and kind in ("and", ",") or (
      is_participle(clause.form) and (kind == "," or kind == "and" and before == "while"))


def _and_is_simultaneous(group, clause):
  """Whether "and" means at the same time: the legs go on, or each arm has an action of its own."""
  every = [*group, clause]
  if not can_be_simultaneous(group, clause) or any(one.steps for one in group):  # "takes three steps and waves"
    return False
  # "picks it up and walks on", "walks to the door and opens it"
  if any(one.part == "arms" and one.verb != "lift" and not actions.stays_low(one.verb, one.part, lower(one.words))
         or _is_at_a_thing(one) and lexicon.IDLE.isdisjoint(other.verb for other in every) for one in every):
    return False
  parts = {one.part for one in every}
  if "body" in parts:
    return all(is_participle(one.form) for one in every)  # "dancing and clapping"
  if "legs" in parts:
    return parts <= {"legs", "arms", "head"} and all(
        actions.is_continuous(one.verb, lower(one.words)) or is_participle(one.form)  # "is sitting and clapping"
        for one in every if one.part == "legs")
  return parts == {"arms", "head"} or parts == {"arms"} and {one.verb for one in every} <= lexicon.ONE_ARM_EACH


def _is_at_a_thing(clause):
  """Whether hands act on a thing where it stands, be it with a named hand, and not on the body itself."""
  words = lower(clause.words)
  thing = words[:words.index("with")] if "with" in words else words
  return bool(thing) and clause.verb in lexicon.AT_A_THING and (lexicon.LIMBS | lexicon.FACE).isdisjoint(thing)
