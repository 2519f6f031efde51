// The part of three.js that player.js uses; bundled into three.min.js (see README.md).
export {
  ACESFilmicToneMapping, AdditiveBlending, AmbientLight, ArrowHelper, BackSide, BoxGeometry,
  BufferAttribute, BufferGeometry, CapsuleGeometry, CircleGeometry, Color, ConeGeometry,
  CylinderGeometry, DirectionalLight, DoubleSide, DynamicDrawUsage, FrontSide, Group,
  HemisphereLight, InstancedMesh, Line, LineBasicMaterial, MathUtils, Matrix4, Mesh,
  MeshBasicMaterial, MeshStandardMaterial, NeutralToneMapping, NoToneMapping, Object3D,
  PCFShadowMap, PCFSoftShadowMap, PerspectiveCamera, PlaneGeometry, PMREMGenerator, PointLight,
  Quaternion, RingGeometry, Scene, ShaderMaterial, ShadowMaterial, SphereGeometry, SpotLight,
  SRGBColorSpace, Vector2, Vector3, Vector4, VSMShadowMap, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
export { RoundedBoxGeometry } from "three/examples/jsm/geometries/RoundedBoxGeometry.js";
export { RoomEnvironment } from "three/examples/jsm/environments/RoomEnvironment.js";
export { toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";
