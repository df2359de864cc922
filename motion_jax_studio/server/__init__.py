"""The studio: a web server that streams motion while it is generated, and generates, edits and exports it on request.

  motion-jax studio

The page in assets/, a Python client and the Blender add-on talk to it with the messages of docs/protocol.md. Needs the
extra `studio`.

  server              opens the port, prints the address, shuts down on Ctrl-C
  security            origin, host, token, rate and size checks before any other code sees a request
  app                 the Starlette application: routes, WebSockets, error responses
  library             loads and compiles the models in a background thread, one `ModelSlot` each
  requests            /v1/generate, /v1/multi-prompt, /v1/edit, /v1/import
  multi_prompt        cache of multi-prompt motions: only the blocks after a change are sampled again
  streams             one live motion per WebSocket
  poses               a robot's configurations or a rig's rotations, in addition to the joints of a stream
  stream_constraints  constraints of a running stream
  exporting           /v1/export: files of a motion, in the formats and rigs that there are
  project             saved projects
  suggestions         prompts that a model can do
  limits              limits of one studio: sizes, counts, rates
  request_types, fields  types of requests; checks of their values, and error messages
  openapi             the OpenAPI description of the requests
  serialization       motions as JSON, blocks of a stream as bytes
"""
