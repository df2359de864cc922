"""Clauses in the order of time: groups of simultaneous ones, one group after the other, all of one subject."""
from motion_jax.text.morphology import is_participle
from motion_jax_studio.language import lexicon, parts
from motion_jax_studio.language.clause import can_be_simultaneous


def subject_of(clauses):
  """The words of the common subject of all clauses, by default "a person"; None if there are several subjects."""
  subjects = [clause.subject for clause in clauses if clause.subject]
  named = [words for words in subjects if words[-1] not in lexicon.PRONOUNS]
  if {"he", "she"} <= {words[-1] for words in subjects}:
    return None
  first = next(iter(named or subjects), lexicon.DEFAULT_SUBJECT)
  for words in named:
    if words != first and words[0] not in lexicon.DETERMINERS - set(lexicon.ONE_MORE):
      return None
  return first


def in_order(clauses):
  """Order [(connector, clause)] in time, as lists of simultaneous clauses; None if one body cannot perform them."""
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
  """Whether the text says so: by "while", "at the same time", a participle after a comma, or "and" after these."""
  return kind == "while" or clause.simultaneous and kind in ("and", ",") or (
      is_participle(clause.form) and (kind == "," or kind == "and" and before == "while"))


def _and_is_simultaneous(group, clause):
  """Whether "and" means at the same time: the legs go on, or each arm has an action of its own."""
  every = [*group, clause]
  if not can_be_simultaneous(group, clause) or any(member.steps for member in group):  # "takes three steps and waves"
    return False
  # "picks it up and walks on", "walks to the door and opens it"
  if any(member.part == "arms" and member.verb != "lift" and not (
      parts.stays_low(member.verb, member.part, member.words))
         or member.verb in lexicon.AT_A_THING and member.words for member in every):
    return False
  moving = {member.part for member in every}
  if "body" in moving:
    return all(is_participle(member.form) for member in every)  # "dancing and clapping"
  if "legs" in moving:
    return moving <= {"legs", "arms", "head"} and all(  # "is sitting and clapping"
        parts.is_continuous(member.verb, member.words) or is_participle(member.form)
        for member in every if member.part == "legs")
  return moving == {"arms", "head"} or moving == {"arms"} and {member.verb for member in every} <= lexicon.ONE_ARM_EACH
