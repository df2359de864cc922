// Requests to the studio. A refusal becomes an Error with the studio's sentence.

import { GONE } from "./messages.js";
import { shares } from "./shares.js";
import { socketAddress } from "./stream.js";

export const token = new URLSearchParams(location.search).get("token") ?? "";

// Addresses are relative to this script, for the studio may be below a path of a proxy.
const address = (path) => new URL(path, import.meta.url);
export const streamAddress = () => socketAddress(address("v1/stream"), token);

const TRIES = 3; // of a request, while the studio says that there are too many
const cancelled = () => Object.assign(new Error("cancelled"), { cancelled: true });

async function ask(path, options = {}, tries = TRIES) {
  let reply;
  try {
    reply = await fetch(address(path), { ...options, headers: { ...options.headers, authorization: `Bearer ${token}` } });
  } catch {
    if (options.signal?.aborted) throw cancelled();
    throw Object.assign(new Error(GONE), { topic: "connection" });
  }
  // Too many requests at once: the studio says when to try again.
  if (reply.status === 429 && tries > 1 && reply.headers.has("retry-after")) {
    await new Promise((done) => setTimeout(done, 1000 * Number(reply.headers.get("retry-after"))));
    return ask(path, options, tries - 1);
  }
  if (reply.ok) return reply;
  const refusal = await reply.json().catch(() => null);
  const error = new Error(refusal?.error?.message ?? `the studio answered with status ${reply.status}`);
  throw Object.assign(error, { status: reply.status });
}

/** Whether the studio is "there", is "gone", or has "refused" this page. */
export const reach = () =>
  ask("v1/status").then(
    () => "there",
    (error) => ([401, 403].includes(error.status) ? "refused" : "gone"),
  );

const POLL = 700; // milliseconds between two requests for progress
let works = 0;

// Sends a long request of a kind; calls report({doing, share, seconds}) about once a second. Ends when its signal aborts.
async function followed(kind, path, options, report, signal) {
  const work = `${Date.now()}-${(works += 1)}`,
    share = shares(kind);
  let complete = false; // then a late answer about progress is ignored
  signal?.addEventListener("abort", () => ask(`v1/cancel?work=${work}`, { method: "POST" }).catch(() => {}), { once: true });
  const timer = setInterval(async () => {
    const found = await ask(`v1/progress?work=${work}`).then((reply) => reply.json()).catch(() => null);
    if (found?.doing && !complete) report({ ...found, share: share.of(found) });
  }, POLL);
  try {
    const reply = await ask(path, { method: "POST", signal, ...options, headers: { "x-work": work, ...options.headers } });
    share.done();
    return reply;
  } finally {
    complete = true;
    clearInterval(timer);
  }
}

const json = async (path, body, report = () => {}, signal = undefined) => {
  const options = { headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
  return (await followed(path, path, options, report, signal)).json();
};

export const models = async () => (await (await ask("v1/models")).json()).models;
export const body = async () => (await ask("body.json")).json();
export const exportChoices = async () => (await ask("v1/export-choices")).json();
export const multiPrompt = (request, report, signal) => json("v1/multi-prompt", request, report, signal);
export const edit = (request, report, signal) => json("v1/edit", request, report, signal);
export const suggestions = async (model, words = "") =>
  (await ask(`v1/suggestions?${new URLSearchParams({ ...(model ? { model } : {}), words })}`)).json();
export const project = (value) => json("v1/project", value);

export async function importFile(file) {
  const name = encodeURIComponent(file.name);
  return (await (await ask(`v1/import?name=${name}`, { method: "POST", body: file })).json()).motion;
}

/** {blob, name} of a motion as a file. */
export async function exportMotion(request, report, signal) {
  const body = JSON.stringify(request);
  const reply = await followed(`export ${request.format}`, "v1/export", { body }, report, signal);
  const name = /filename="([^"]*)"/.exec(reply.headers.get("content-disposition") ?? "")?.[1];
  return { blob: await reply.blob(), name: name ?? `motion.${request.format}` };
}

export function download(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
