{{/*
The pod of a process, the same for all: no rights, nothing to write to but /tmp and its volume, settings from a file.
Takes root, process, image, and volume: the name of the volume at /var/lib/fleetsight, if it has one.
*/}}
{{- define "fleetsight.pod" -}}
{{- $given := index .root.Values .process }}
{{- $scheme := hasKey ($given.settings | default dict) "web_certificate" | ternary "HTTPS" "HTTP" }}
{{- $certificate := include "fleetsight.certificate" . }}
metadata:
  labels:
    {{- include "fleetsight.labels" . | nindent 4 }}
  annotations:
    checksum/settings: {{ include "fleetsight.settings" . | sha256sum }}
spec:
  automountServiceAccountToken: false
  enableServiceLinks: false
  terminationGracePeriodSeconds: 10
  {{- with .root.Values.image.pullSecrets }}
  imagePullSecrets:
    {{- range . }}
    - name: {{ . }}
    {{- end }}
  {{- end }}
  securityContext:
    runAsNonRoot: true
    runAsUser: 10001
    runAsGroup: 10001
    fsGroup: 10001
    seccompProfile: {type: RuntimeDefault}
  containers:
    - name: {{ .process }}
      image: {{ .root.Values.image.registry }}/fleetsight-{{ .image }}:{{ .root.Values.image.tag | default .root.Chart.AppVersion }}
      imagePullPolicy: {{ .root.Values.image.pullPolicy }}
      args: [{{ .process }}, --config, /etc/fleetsight/settings/settings.yaml]
      env:
        - {name: FLEETSIGHT_HEARTBEAT_FILE, value: /tmp/heartbeat}
      {{- if eq .process "monitor" }}
      {{- with $given.history }}
        - name: FLEETSIGHT_HISTORY
          {{- if .secret }}
          valueFrom: {secretKeyRef: {name: {{ .secret }}, key: {{ .key }}}}
          {{- else }}
          value: sqlite:////var/lib/fleetsight/history.db
          {{- end }}
      {{- end }}
      ports:
        - {name: zenoh, containerPort: 7447}
        - {name: web, containerPort: 8080}
      startupProbe:
        httpGet: {path: /healthz, port: web, scheme: {{ $scheme }}}
        periodSeconds: 2
        failureThreshold: 60
      readinessProbe:
        tcpSocket: {port: web}
        periodSeconds: 5
      livenessProbe:
        httpGet: {path: /healthz, port: web, scheme: {{ $scheme }}}
        periodSeconds: 10
        timeoutSeconds: 5
        failureThreshold: 6
      {{- else }}
      readinessProbe:
        exec:
          command: [sh, -c, "test -e /tmp/heartbeat && ! grep -q starting /tmp/heartbeat"]  # images of 0.2.0 say nothing
        periodSeconds: 5
      livenessProbe:
        exec:
          command: [python3, -c, "import os, sys, time; sys.exit(time.time() - os.stat('/tmp/heartbeat').st_mtime > 30)"]
        initialDelaySeconds: 15
        periodSeconds: 15
        timeoutSeconds: 5
      {{- end }}
      securityContext:
        allowPrivilegeEscalation: false
        readOnlyRootFilesystem: true
        capabilities: {drop: [ALL]}
      {{- $resources := deepCopy $given.resources }}
      {{- if $given.gpus }}
      {{- $_ := set $resources "limits" (merge (dict $given.gpuResource $given.gpus) $resources.limits) }}
      {{- end }}
      resources:
        {{- toYaml $resources | nindent 8 }}
      volumeMounts:
        - {name: settings, mountPath: /etc/fleetsight/settings, readOnly: true}
        - {name: tmp, mountPath: /tmp}
        {{- if .volume }}
        - {name: {{ .volume }}, mountPath: /var/lib/fleetsight}
        {{- end }}
        {{- if $certificate }}
        - {name: tls, mountPath: /etc/fleetsight/tls, readOnly: true}
        {{- if eq .process "monitor" }}
        - {name: access, mountPath: /etc/fleetsight/access, readOnly: true}
        {{- end }}
        {{- end }}
        {{- if $given.files }}
        - {name: files, mountPath: /etc/fleetsight/files, readOnly: true}
        {{- end }}
        {{- if $given.models }}
        - {name: models, mountPath: /models, readOnly: true}
        {{- end }}
  volumes:
    - name: settings
      configMap: {name: {{ include "fleetsight.name" .root }}-{{ .process }}}
    - name: tmp
      emptyDir: {}
    {{- if $certificate }}
    - name: tls
      secret:
        secretName: {{ $certificate }}
        defaultMode: 0440
        items:
          - {key: ca.crt, path: ca.pem}
          - {key: tls.crt, path: {{ $certificate }}.pem}
          - {key: tls.key, path: {{ $certificate }}.key}
    {{- if eq .process "monitor" }}
    - name: access
      configMap: {name: {{ .root.Values.tls.access }}}
    {{- end }}
    {{- end }}
    {{- if $given.files }}
    - name: files
      configMap: {name: {{ $given.files }}}
    {{- end }}
    {{- if $given.models }}
    - name: models
      persistentVolumeClaim: {claimName: {{ $given.models }}, readOnly: true}
    {{- end }}
  {{- with $given.nodeSelector }}
  nodeSelector:
    {{- toYaml . | nindent 4 }}
  {{- end }}
  {{- with $given.tolerations }}
  tolerations:
    {{- toYaml . | nindent 4 }}
  {{- end }}
{{- end }}
