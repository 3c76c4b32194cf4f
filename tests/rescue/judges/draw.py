import sys,re,math
fn,idx=sys.argv[1],int(sys.argv[2])
Y={};order=[];P={};E={}
for l in open(fn):
    w=l.split(None,4)
    if not w: continue
    if w[0]=='Y':
        k=w[1]
        if k not in Y: order.append(k)
        Y[k]=l
    elif w[0]=='P': P.setdefault(w[1],[]).append(tuple(map(float,l.split()[2:7])))
    elif w[0]=='E' and w[3]=='Heard' and 'Engine(Dock)' in l: E.setdefault(w[1],[]).append(float(w[2]))
k=order[idx-1];l=Y[k];parts=l.split(' || ')
W=float(re.search(r'width: ([\d.]+)',parts[0])[1]);D=float(re.search(r'depth: ([\d.]+)',parts[0])[1])
print(k[-6:],re.search(r"floor: \w+, walls[^)]*",parts[0])[0],re.search(r"heading_degrees: [-\d.]+",parts[2])[0])
S=.15;nx,ny=int(W/S)+1,int(D/S)+1
g=[[' ']*nx for _ in range(ny)]
def put(x,y,c):
    i,j=int(x/S),int(y/S)
    if 0<=i<nx and 0<=j<ny: g[j][i]=c
segs=[(0,0,W,0),(W,0,W,D),(W,D,0,D),(0,D,0,0)]
for m in re.finditer(r'from: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), to: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), thickness: ([\d.]+)',parts[1]):
    segs.append(tuple(map(float,m.groups()[:4])))
for a,b,c,d in segs:
    n=int(math.hypot(c-a,d-b)/.05)+1
    for i in range(n+1): put(min(max(a+(c-a)*i/n,.01),W-.01),min(max(b+(d-b)*i/n,.01),D-.01),'#')
for m in re.finditer(r'Furniture \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), length: ([\d.]+), width: ([\d.]+), height: ([\d.]+), heading_degrees: ([-\d.]+)',l):
    x,y,L,Wd,H,h=map(float,m.groups());h=math.radians(h);c,s=math.cos(h),math.sin(h)
    for a in range(21):
        for b in range(21):
            u,v=(a/20-.5)*L,(b/20-.5)*Wd;put(x+c*u-s*v,y+s*u+c*v,'%')
for m in re.finditer(r'Post \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), radius: ([\d.]+)',l):
    put(float(m[1]),float(m[2]),'o')
for p in P[k]: 
    put(p[1],p[2],'.')
n=0
for t in E[k]:
    p=([P[k][0]]+[p for p in P[k] if p[0]<=t])[-1]
    put(p[1],p[2],chr(ord('a')+n) if n<26 else chr(ord('A')+n-26));n+=1
sx,sy,sh=map(float,re.search(r'Station \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), heading_degrees: ([-\d.]+)',l).groups())
put(min(max(sx,.01),W-.01),min(max(sy,.01),D-.01),'$')
for m in re.finditer(r'Walker \{.*?through: \[(.*?)\]',parts[4]):
    pts=[(float(a),float(b)) for a,b in re.findall(r'Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)',m[1])]
    for a,b in zip(pts,pts[1:]):
        for i in range(21):
            x=a[0]+(b[0]-a[0])*i/20;y=a[1]+(b[1]-a[1])*i/20
            if g[int(y/S)][int(x/S)] in ' .': put(x,y,'w')
for r in reversed(g): print(''.join(r))
print('searches',[round(t) for t in E[k]],'end',P[k][-1])
