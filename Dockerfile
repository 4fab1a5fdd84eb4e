# The program alone, from what scripts/build_release.sh program made: docker build -t graintrain .
#     docker run --rm -v "$PWD:/work" graintrain run sedimentation --out out
FROM scratch
ARG MACHINE=x86_64
COPY dist/linux-${MACHINE}/graintrain /graintrain
WORKDIR /work
ENTRYPOINT ["/graintrain"]
