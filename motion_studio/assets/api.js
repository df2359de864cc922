// Requests to the studio. A refusal becomes an Error with the studio's sentence.

import { GONE } from "./messages.js";
import { socketAddress } from "./stream.js";

export const token = new URLSearchParams(location.search).get("token") ?? "";

// Addresses are relative to this script, for the studio may be below a path of a proxy.
const address = (path) => new URL(path, import.meta.url);
export const streamAddress = () => socketAddress(address("v1/stream"), token);

async function ask(path, options = {}) {
  let reply;
  try {
    reply = await fetch(address(path), { ...options, headers: { ...options.headers, authorization: `Bearer ${token}` } });
  } catch {
    throw Object.assign(new Error(GONE), { topic: "connection" });
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

// Sends a long request; calls report({doing, done, of, seconds}) about once a second.
async function followed(send, report) {
  const work = `${Date.now()}-${(works += 1)}`;
  let complete = false; // then a late answer about progress is ignored
  const timer = setInterval(async () => {
    const found = await ask(`v1/progress?work=${work}`).then((reply) => reply.json()).catch(() => null);
    if (found?.doing && !complete) report(found);
  }, POLL);
  try {
    return await send({ "x-work": work });
  } finally {
    complete = true;
    clearInterval(timer);
  }
}

const json = async (path, body, report = () => {}) =>
  followed(async (headers) => {
    const type = { "content-type": "application/json" };
    return (await ask(path, { method: "POST", headers: { ...headers, ...type }, body: JSON.stringify(body) })).json();
  }, report);

export const models = async () => (await (await ask("v1/models")).json()).models;
export const body = async () => (await ask("body.json")).json();
export const exportChoices = async () => (await ask("v1/export-choices")).json();
export const multiPrompt = (request, report) => json("v1/multi-prompt", request, report);
export const edit = (request, report) => json("v1/edit", request, report);
export const suggestions = async (model, words = "") =>
  (await ask(`v1/suggestions?${new URLSearchParams({ ...(model ? { model } : {}), words })}`)).json();
export const project = (value) => json("v1/project", value);

export async function importFile(file) {
  const name = encodeURIComponent(file.name);
  return (await (await ask(`v1/import?name=${name}`, { method: "POST", body: file })).json()).motion;
}

/** {blob, name} of a motion as a file. */
export async function exportMotion(request, report) {
  const reply = await followed(
    (headers) => ask("v1/export", { method: "POST", headers, body: JSON.stringify(request) }),
    report,
  );
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
