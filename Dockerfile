# The library and the application with the studio, run by a user without rights (docs/containers.md).
#
#   docker build -t motion-jax .                          for a CPU
#   docker build --target cuda -t motion-jax:cuda .       for an NVIDIA GPU; CUDA comes with jax's packages
FROM python:3.11-slim AS source
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR /source
RUN python -m venv /opt/motion-jax
COPY pyproject.toml README.md LICENSE NOTICE ./
COPY .ci/constraints.txt .ci/constraints.txt
COPY configs configs
COPY motion_jax motion_jax
COPY motion_jax_studio motion_jax_studio

FROM source AS install-cpu
RUN /opt/motion-jax/bin/pip install --constraint .ci/constraints.txt ".[studio]"

FROM source AS install-cuda
RUN /opt/motion-jax/bin/pip install --constraint .ci/constraints.txt ".[studio,cuda13]"

FROM python:3.11-slim AS base
# Compiled programs are cached below HOME, which works for any user of `docker run --user` as well.
ENV PATH=/opt/motion-jax/bin:$PATH HOME=/home/motion PYTHONUNBUFFERED=1
LABEL org.opencontainers.image.title="motion_jax" \
  org.opencontainers.image.licenses="Apache-2.0 AND CC-BY-NC-4.0 AND CC-BY-SA-4.0 AND MIT AND BSD-3-Clause"
RUN useradd --uid 1000 --no-create-home --home-dir /home/motion motion \
  && install --directory --mode=1777 /home/motion /work
WORKDIR /work
EXPOSE 8765
ENTRYPOINT ["motion-jax"]
CMD ["--help"]

FROM base AS cuda
COPY --from=install-cuda /opt/motion-jax /opt/motion-jax
USER motion

FROM base AS cpu
ENV JAX_PLATFORMS=cpu
COPY --from=install-cpu /opt/motion-jax /opt/motion-jax
USER motion
