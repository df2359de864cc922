"""A studio in the browser: a server that streams motion while it is made, and makes, edits and exports it on request.

  motion-jax studio

A page, a Python client or a Blender add-on talks to it by the messages of docs/protocol.md. `app` is the Starlette
application, `streams` one live motion each, `stories` motions of several prompts that are made anew only from where
they changed, `guard` what is refused before anything else looks at it. Needs the extra `studio`.
"""
