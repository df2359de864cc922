// BERT's word pieces of a sentence, from the table in model.json; and what to say about a sentence.

export class Words {
  // table: `tokenizer` of model.json; known: words that the text encoder has learned; most: pieces of a caption.
  constructor(table, known, most) {
    Object.assign(this, {table, most});
    this.number = new Map(table.pieces.map((piece, i) => [piece, i]));
    this.known = new Set(known);
  }

  // Lower case, no accents, no control characters; punctuation and Chinese characters stand alone.
  split(sentence) {
    const plain = sentence.replace(/[\p{Cc}\p{Cf}\p{Co}\p{Cs}\ufffd]/gu, (c) => (/[\t\n\r]/.test(c) ? ' ' : ''))
      .normalize('NFD').replace(/\p{Mn}/gu, '').toLowerCase();
    return plain.match(/[\u4e00-\u9fff\u3400-\u4dbf\uf900-\ufaff\u{20000}-\u{2a6df}]|[\p{P}$+<=>^`|~]|[^\s\p{P}$+<=>^`|~\u4e00-\u9fff\u3400-\u4dbf]+/gu) ?? [];
  }

  pieces(word) {
    const characters = [...word], found = [];
    if (characters.length > 100) return [this.table.unknown];
    for (let at = 0; at < characters.length;) {
      let end = characters.length, number;
      for (; end > at; end--) {
        number = this.number.get((at ? '##' : '') + characters.slice(at, end).join(''));
        if (number !== undefined) break;
      }
      if (end === at) return [this.table.unknown];
      found.push(number);
      at = end;
    }
    return found;
  }

  /** Numbers of all pieces, the first and the last special one included. */
  encode(sentence) {
    return [this.table.first, ...this.split(sentence).flatMap((word) => this.pieces(word)), this.table.last];
  }

  isKnown(word) {
    const forms = [word, word.replace(/(s|es|ed|ing|ly|er)$/, ''), word.replace(/ies$|ied$|ily$/, 'y'), word.replace(/(ed|ing|es|er)$/, 'e'),
      word.replace(/(.)\1(ed|ing|er)$/, '$1'), `${word}s`, `${word}ing`, `${word}ed`, word.replace(/e$/, 'ing')];
    return word.length < 3 || forms.some((form) => this.known.has(form) || this.known.has(`${form}s`) || this.known.has(`${form}ing`));
  }

  /** {ids, prompt, note}: pieces that the model takes, and one sentence about what it cannot read ('' for nothing).
      ids is null where there is nothing to act on. */
  read(sentence) {
    const prompt = sentence.trim().replace(/\s+/g, ' ');
    const words = prompt.toLowerCase().match(/\p{L}+/gu) ?? [];
    if (!words.length) return {ids: null, prompt, note: 'Say what the person does, such as “a person waves”.'};
    const unknown = [...new Set(words.filter((word) => !this.isKnown(word)))];
    const latin = words.filter((word) => /^[a-z]+$/.test(word.normalize('NFD').replace(/\p{Mn}/gu, ''))).length;
    if (latin < words.length / 2 || (words.length > 1 && unknown.length > words.length / 2)) {
      return {ids: null, prompt, note: 'This model reads English only; try “a person walks forward”.'};
    }
    if (unknown.length === words.length) {
      return {ids: null, prompt, note: 'The model has learned none of these words; try “a person walks forward”.'};
    }
    let ids = this.encode(prompt), note = '';
    if (ids.length > this.most) {
      ids = [...ids.slice(0, this.most - 1), this.table.last];
      note = `This is long: the model reads the first ${this.most - 2} word pieces.`;
    } else if (unknown.length) {
      const shown = unknown.slice(0, 4).map((word) => `“${word.slice(0, 24)}”`).join(', ');
      note = `The model has not learned ${shown}${unknown.length > 4 ? ' and others' : ''}; it goes by the other words.`;
    } else if (/\p{Extended_Pictographic}/u.test(prompt)) {
      note = 'Pictures mean nothing to the model; it goes by the words.';
    }
    return {ids, prompt, note};
  }
}
