import sys,re,math,collections,heapq
sys.argv_=sys.argv
from pred import g,gain,C,B4
def geo2(l):
    # segments incl. furniture edges
    parts=l.split(' || ');W,D,segs,_=g['geo'](l)
    F=[]
    for m in re.finditer(r'Furniture \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), length: ([\d.]+), width: ([\d.]+), height: ([\d.]+), heading_degrees: ([-\d.]+)',l):
        x,y,L,Wd,H,h=map(float,m.groups());h=math.radians(h);c,s=math.cos(h),math.sin(h)
        P=[(x+c*a*L/2-s*b*Wd/2,y+s*a*L/2+c*b*Wd/2) for a,b in ((-1,-1),(1,-1),(1,1),(-1,1))]
        for i in range(4): F.append(P[i]+P[(i+1)%4])
    return W,D,segs,F
def dseg(x,y,s):
    x1,y1,x2,y2=s;dx,dy=x2-x1,y2-y1;L=dx*dx+dy*dy
    t=0 if L==0 else max(0,min(1,((x-x1)*dx+(y-y1)*dy)/L))
    return math.hypot(x-x1-t*dx,y-y1-t*dy)
S=.15
def analyse(fn,maxp=1.5):
    by=collections.defaultdict(list);Y={}
    for l in open(fn):
        w=l.split(None,3)
        if w and w[0]=='Y': Y[w[1]]=l
        elif w and w[0] in 'EP': by[w[1]].append(l)
    cnt=collections.Counter();ex=[];det=collections.Counter()
    for k,ls in by.items():
        W,D,segs,F=geo2(Y[k]);have=set();pos=None;cur=None;n=0;post=None
        nx,ny=int(W/S)+1,int(D/S)+1
        free={}
        for i in range(nx):
            for j in range(ny):
                x,y=(i+.5)*S,(j+.5)*S
                free[(i,j)]=min(min(dseg(x,y,s) for s in segs),min([dseg(x,y,s) for s in F] or [9]))>.2
        # inside of furniture is unreachable anyway
        G={}
        def handle():
            ev,se=cur;b,t=post
            r=b[2]-t[2]
            def bel(x,y):
                dx,dy=x-t[0],y-t[1]
                X=b[0]+math.cos(r)*dx-math.sin(r)*dy;Yb=b[1]+math.sin(r)*dx+math.cos(r)*dy
                return (math.floor(X/C),math.floor(Yb/C))
            # true dijkstra
            st=(int(t[0]/S),int(t[1]/S));q=[(0,st)];before={st:None};tgt=None;seen=0
            while q:
                d,c=heapq.heappop(q)
                if c[0]%3==0 and c[1]%3==0 and d>2:
                    if c not in G: G[c]=g['seen'](((c[0]+.5)*S,(c[1]+.5)*S),segs,W,D)
                    if len(G[c]-have)*.0625>3: tgt=c;break
                for a,bb in B4:
                    e=(c[0]+a,c[1]+bb)
                    if free.get(e) and e not in before: before[e]=c;heapq.heappush(q,(d+1,e))
            if not tgt: cnt['nothing left near']+=1;return
            path=[];c=tgt
            while c: path.append(c);c=before[c]
            path.reverse()
            why='gain'
            for i,c in enumerate(path[3:]):
                kc=bel((c[0]+.5)*S,(c[1]+.5)*S);v=ev.get(kc,0)
                if v>.2: why='occ%d'%min(4,int(v+.5));break
                if v>=-.2: why='unknown';break
            else:
                kc=bel((tgt[0]+.5)*S,(tgt[1]+.5)*S);p=gain(ev,se,kc)
                room=all(ev.get((bel((c[0]+.5)*S,(c[1]+.5)*S)[0]+a,bel((c[0]+.5)*S,(c[1]+.5)*S)[1]+bb),0)<=.2 for c in path[3:] for a,bb in B4)
                why='gain %s%s'%('p<1' if p<1 else 'p<2' if p<2 else 'p>2','' if room else ' narrow')
            
            if why.startswith('gain p<'):
                kt=bel((tgt[0]+.5)*S,(tgt[1]+.5)*S);tot=collections.Counter()
                for (cx,cy) in G[tgt]-have:
                    x,y=(cx+.5)*.25,(cy+.5)*.25
                    kc=bel(x,y);v=ev.get(kc,0)
                    d=math.dist(kc,kt)
                    if d>20: tot['far']+=1;continue
                    # first obstacle on the line
                    n_=int(d)+1;blk=None;unk=0
                    for i in range(1,n_):
                        q_=(round(kt[0]+(kc[0]-kt[0])*i/n_),round(kt[1]+(kc[1]-kt[1])*i/n_));vv=ev.get(q_,0)
                        if vv>.2: blk='occ';break
                        if vv>=-.2:
                            unk+=1
                            if any(ev.get((q_[0]+a,q_[1]+b_),0)>.2 for a,b_ in B4): blk='beside';break
                            if unk>6: blk='into';break
                    if kc in se: tot['searched '+('free' if v<-.2 else 'unknown' if v<=.2 else 'occ')]+=1
                    elif v>.2: tot['is occ']+=1
                    elif blk: tot[blk]+=1
                    else: tot['ok']+=1
                for kk_,vv in tot.items(): det[kk_]+=vv
                why+=' '+str(dict(tot))
            cnt[why.split(' {')[0]]+=1;ex.append((k[-6:],n,why,'%.1fm'%(len(path)*S)))
        for l in ls:
            w=l.split(None,4)
            if w[0]=='P': pos=tuple(map(float,l.split()[3:6]));continue
            if w[3]=='Heard' and 'Engine(Dock)' in l and pos:
                s=g['seen'](pos[:2],segs,W,D);new=len(s-have)*.0625
                if cur and post and new<1: handle()
                have|=s
            elif w[3]=='Log':
                if ' B ' in l:
                    t=l.split();i=t.index('B');post=(tuple(map(float,t[i+1:i+4])),pos);n+=1;cur=({},set())
                elif ' M ' in l and cur:
                    t=l.split()
                    for c in t[t.index('M')+1:]:
                        a=c.split(',');kk=(int(a[0]),int(a[1]));cur[0][kk]=int(a[2])/10
                        if a[3]=='1': cur[1].add(kk)
    print(cnt,det)
    return ex
for f in sys.argv[1:]:
    for e in analyse(f): print(*e)
