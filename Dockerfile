# Echelon with everything that reads robots and logs, fits models and designs motions.
#
#   docker build -t echelon .
#   docker run --rm -u "$(id -u):$(id -g)" -v "$PWD:/work" echelon derive arm.urdf
FROM python:3.12-slim AS build
COPY . /src
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /dist /src

FROM python:3.12-slim
COPY --from=build /dist /dist
RUN pip install --no-cache-dir "$(echo /dist/*.whl)[excite,identify,mjcf,ros,symbolic]" && rm -r /dist
# any user may run it: machine code is kept where every user can write
ENV ECHELON_CACHE=/tmp/echelon
WORKDIR /work
ENTRYPOINT ["echelon"]
